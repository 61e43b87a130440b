"""Stretches of a recording, as rows of a batch."""
