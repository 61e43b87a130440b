"""What is wrong with a recording, and what its motion can tell."""
