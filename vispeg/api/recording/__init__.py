"""Make recordings in simulation, convert logs to recordings, and check recordings."""
