"""Effects of a camera's lens and pose, and of objects before the lens."""
