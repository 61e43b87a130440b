"""Linear algebra of many small problems: threads of BLAS would only wait for one another."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let BLAS compute with one thread meanwhile, in this whole process; afterwards it has what it had.

    With as many threads as cores a diagnosis takes 2.3 times as long on two cores, and 15 times the processor time on
    more. Threads of PyTorch and of MuJoCo are others.
    """
    import scipy.linalg  # noqa: F401  # its BLAS is not NumPy's, and would come in later with all its threads
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, "blas"):
        yield
