"""Commands before they are recorded: from a file, for camera calibration, and slowed down to speed limits."""
