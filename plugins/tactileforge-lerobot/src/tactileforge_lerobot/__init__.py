"""LeRobot's folder format, version 3, read and written, for tactileforge (`docs/lerobot.md`)."""
