"""Recordings of a cell, each kind of evidence read by its room, and one diagnosis over all of them."""
