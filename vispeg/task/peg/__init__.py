"""The peg-in-hole task: what it asks, sees, rewards and calls a failure."""
