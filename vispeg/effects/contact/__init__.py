"""Effects of contact: friction, stiffness, damping, compliance and grip."""
