"""Image networks of timm as touch encoders, and as teachers."""
