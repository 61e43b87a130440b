"""Code that several effects share."""
