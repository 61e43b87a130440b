"""How files that a user may hand in are read: within limits, as plain data, or with one clear error."""
