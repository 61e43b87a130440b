"""Effects between a command and the torque at the joint: delays, gains, limits and servo loops."""
