"""Contact as evidence: the robot cut at the wrist's force sensor, and the effects that its wrench shows."""
