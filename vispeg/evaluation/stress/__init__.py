"""Where policies fail though they do well on average: one thing at a time, paired over seeds."""
