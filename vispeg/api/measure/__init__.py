"""Measure actuators and objects, as `vispeg measure` does."""
