"""Diagnosis of pictures: effects of a camera, or of the arm that carries it."""
