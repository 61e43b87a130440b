"""What a tool that hits something tells, which its measured path does not hold."""
