"""Contact comparison: the robot cut at the wrist's force sensor, and the effects visible in its wrench."""
