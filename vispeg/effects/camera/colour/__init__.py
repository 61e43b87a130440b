"""Effects of the image sensor and the codec on light and colour."""
