"""What a lens, a sensor and a codec make of a picture."""
