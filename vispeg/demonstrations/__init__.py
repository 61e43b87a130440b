"""Scripted episodes of the task as a dataset holds them: played once, drawn in several looks. No torch."""
