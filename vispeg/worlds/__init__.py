"""Worlds: a nominal robot plus effects, drawn or with ranges to draw from, and the files that state them."""
