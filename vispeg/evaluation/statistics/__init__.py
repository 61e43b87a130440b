"""Intervals, tests and ranks: what episodes say, with how much doubt."""
