"""Commands about what a model is missing: compare, diagnose, fit, add, effects, report."""
