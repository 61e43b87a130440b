"""Policies and models for programs that know nothing of this package."""
