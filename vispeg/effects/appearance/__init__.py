"""Effects of what cameras see: colours, textures, lamps and surroundings."""
