"""Recordings whose closed loop even the right model would not follow; each module says what is compared instead.

The causes are noise in the feedback, a saturated drive, a soft null space, lost control, and joint stops of the model
that the robot does not have.
"""
