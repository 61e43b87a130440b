"""Recordings: made in simulation, converted from a log, checked."""
