"""The types of what the JSON files of evaluations hold."""
