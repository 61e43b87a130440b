"""Closed-loop replays of the whole arm under its recorded controller: impacts, and whole episodes as a final check."""
