"""Pictures beside joint readings: `frames/` of a recording, in memory and on disk."""
