"""A delay line for every simulation and joint, with fractional delays by linear interpolation."""

from __future__ import annotations

import numpy as np


class DelayLine:
    """`line(value, delay)` returns the value of `delay` seconds ago; before the first call it held the first value.

    Args:
        step: time between calls, s.
        longest: greatest delay, s.
    """

    def __init__(self, step: float, longest: float):
        self.step = step
        self.size = int(np.ceil(longest / step - 1e-9)) + 2  # `delayed` takes lags up to size - 2
        self.buffer: np.ndarray | None = None
        self.head = 0
        self.fresh: np.ndarray | None = None  # rows that restart with the next value

    def forget(self, rows: np.ndarray) -> None:
        """Restart these rows: their next value counts as their value at all earlier times."""
        self.fresh = rows if self.fresh is None else np.union1d(self.fresh, rows)

    def __call__(self, value: np.ndarray, delay: np.ndarray) -> np.ndarray:
        from vispeg.kernels.delay import delayed

        if self.buffer is None:
            self.buffer = np.repeat(value[None], self.size, axis=0)
        elif self.fresh is not None:
            self.buffer[:, self.fresh] = value[self.fresh]
        self.fresh = None
        lag = delay / self.step
        if lag.max(initial=0.0) > self.size - 2:  # a row that restarted may have a longer delay
            self._grow(int(np.ceil(lag.max())) + 2)
        self.head = (self.head + 1) % self.size
        self.buffer[self.head] = value
        out = np.empty(value.size)
        delayed(self.buffer.reshape(self.size, -1), self.head, lag.ravel(), out)
        return out.reshape(value.shape)

    def _grow(self, size: int) -> None:
        """Enlarge the buffer to `size` values; the additional past ones are copies of the oldest."""
        assert self.buffer is not None  # it has held a value
        order = (self.head + 1 + np.arange(self.size)) % self.size  # oldest first
        past = self.buffer[order]
        self.buffer = np.concatenate([np.repeat(past[:1], size - self.size, axis=0), past])
        self.size, self.head = size, size - 1
