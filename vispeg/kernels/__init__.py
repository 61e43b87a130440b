"""Inner loops, compiled by numba. Import these modules inside functions that call them: numba takes half a second."""
