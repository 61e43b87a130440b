"""Effects of masses, centres of mass and gravity."""
