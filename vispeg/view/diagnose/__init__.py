"""The page of a diagnosis, and the worker behind it."""
