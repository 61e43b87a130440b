"""Between a command and the torque at the joint."""
