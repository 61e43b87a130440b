"""Measurements of actuators and objects, with the uncertainty of each number."""
