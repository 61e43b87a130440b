"""Figures of a page: curves, bars, pictures of the robot, and their colours."""
