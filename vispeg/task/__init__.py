"""The contact task: a peg, a hole, an arm under operational space control, and what may differ between worlds."""
