"""Recordings of a robot in its cell: motions that touch, the run that records them, and its replay."""
