"""Recordings for the Rerun viewer (https://rerun.io), of the extra `viz`: an episode, a comparison."""
