"""Colours, textures, lamps and surroundings."""
