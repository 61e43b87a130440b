"""Conclusions of a search: verdict, competing models, intervals, minimum detectable sizes, the next motion."""
