"""Read untrusted files as plain data within limits, or raise one clear error."""
