"""Errors that a verdict on contact allows for: of sensors and kinematics, of forms of law, of pieces that wedge."""
