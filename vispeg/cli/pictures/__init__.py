"""Commands about cameras and what they see: camera, render, dataset."""
