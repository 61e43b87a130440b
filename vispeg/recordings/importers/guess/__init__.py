"""Proposes a map of columns from a table's header and ranges, with a reason for each, for a person to confirm."""
