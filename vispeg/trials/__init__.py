"""Policies on robots: the run loop, drivers, a robot in simulation behind a socket, and trials as files."""
