"""Fitting and acceptance of effects: search, judging on held-out blocks, backward deletion."""
