"""Loops that are closed over noise, over a saturated drive, or against stops that are none."""
