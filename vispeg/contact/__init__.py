"""Comparison and diagnosis of contact by the wrench at the wrist; the arm before the force sensor is left out."""
