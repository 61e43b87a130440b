"""Rendering in shards: planned, made in processes, put in their place."""
