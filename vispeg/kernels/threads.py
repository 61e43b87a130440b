"""Restrict BLAS to one thread: with many small problems, its threads would only wait for one another."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let BLAS use one thread in the whole process during the body, and then as many as before.

    With as many threads as cores, a diagnosis takes 2.3 times as long on two cores, and 15 times the processor time on
    more. Threads of PyTorch and MuJoCo are not affected.
    """
    import scipy.linalg  # noqa: F401  # its BLAS is not NumPy's; if loaded later, it would use all its threads
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, "blas"):
        yield
