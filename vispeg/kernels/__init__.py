"""Machine code of the inner loops, by numba. Import its modules where they are called: numba takes half a second."""
