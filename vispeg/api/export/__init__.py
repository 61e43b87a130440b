"""Export policies and models for other programs."""
