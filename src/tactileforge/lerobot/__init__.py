"""LeRobot's folder format, version 3, read and written (`docs/lerobot.md`)."""
