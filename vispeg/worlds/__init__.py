"""Worlds: a nominal robot plus effects, whose parameters are fixed or drawn from ranges, and the files of these."""
