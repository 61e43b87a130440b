"""Effects of a joint: friction, springs, play and inertia."""
