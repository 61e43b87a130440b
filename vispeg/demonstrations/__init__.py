"""Make datasets of a task's scripted expert: each episode is played once and rendered in several looks. No torch."""
