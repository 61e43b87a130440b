"""Naming what a camera, or the arm that carries it, does to its pictures."""
