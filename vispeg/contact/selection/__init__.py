"""Search over effects of contact: screening profiles, fits, acceptance and intervals."""
