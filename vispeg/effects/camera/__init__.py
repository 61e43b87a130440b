"""Effects of cameras: lens, image sensor, depth, timing and codec."""
