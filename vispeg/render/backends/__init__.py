"""What draws: OpenGL, Filament or rays, one interface over them, and the lens put on after."""
