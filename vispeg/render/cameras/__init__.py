"""Cameras: intrinsics and place, their files, their rows in a model, the images that they deliver."""
