"""Recordings whose closed loop even the right model would not follow: noise in the feedback, a saturated drive, a soft
null space, lost control, joint stops that are not there. Each module says what is compared instead.
"""
