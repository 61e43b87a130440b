"""Measurements of actuators and objects: what `vispeg measure` does, from Python."""
