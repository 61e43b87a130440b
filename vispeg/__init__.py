"""Finds what a robot model is missing, and trains peg insertion that transfers."""

__version__ = "0.1.0"
