"""Masses, centres of mass, and how the base stands."""
