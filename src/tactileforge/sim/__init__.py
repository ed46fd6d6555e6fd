"""Touch simulated: shapes, contact mechanics, motions and optics."""
