"""Conclusions from a finished search: verdict, rivals, intervals, minimum detectable sizes, the next motion."""
