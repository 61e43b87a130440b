"""Where policies fail though they do well on average: pushes, sweeps, the solver, a suite over versions."""
