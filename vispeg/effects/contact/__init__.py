"""What touches, and how."""
