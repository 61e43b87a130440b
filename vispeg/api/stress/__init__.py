"""Stress tests of policies: pushes, parameter sweeps, the contact solver, and a suite over versions."""
