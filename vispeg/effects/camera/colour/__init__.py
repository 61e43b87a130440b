"""What a sensor and a codec make of light and colour."""
