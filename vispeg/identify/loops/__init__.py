"""Special cases of closed loops: noise in the feedback, saturated drives, lost control, wrong joint stops."""
