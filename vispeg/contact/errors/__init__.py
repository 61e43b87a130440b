"""Errors allowed for in a contact verdict: of sensors, kinematics, contact laws and wedged parts."""
