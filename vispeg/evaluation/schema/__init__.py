"""What the JSON files of evaluations hold, as types: docs/formats.md says what the values mean."""
