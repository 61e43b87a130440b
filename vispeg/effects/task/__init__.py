"""Effects of the task's parts: poses of held part and hole, grip, clearance, and the believed goal."""
