"""Labels of frames: actions, alignment in time, augmentation."""
