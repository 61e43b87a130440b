"""Actors, critics and what they are made of."""
