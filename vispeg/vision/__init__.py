"""Pictures as measurements: what a model says that a camera sees, and how far the picture is from it."""
