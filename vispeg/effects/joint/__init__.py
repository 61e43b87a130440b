"""Friction, springs and play in a joint."""
