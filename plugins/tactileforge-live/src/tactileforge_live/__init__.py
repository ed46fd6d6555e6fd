"""Touch sensors at work: recording, live view and calibration."""
