"""Pages on success: the transfer gap, one policy's evaluation, suites, sweeps and stress tests. One section a file."""
