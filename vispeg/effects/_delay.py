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
        self.step, self.size = step, int(np.ceil(longest / step - 1e-9)) + 2
        self.buffer: np.ndarray | None = None
        self.head = 0

    def __call__(self, value: np.ndarray, delay: np.ndarray) -> np.ndarray:
        if self.buffer is None:
            self.buffer = np.repeat(value[None], self.size, axis=0)
        self.head = (self.head + 1) % self.size
        self.buffer[self.head] = value
        lag = delay / self.step
        whole = np.minimum(lag.astype(int), self.size - 2)
        part = lag - whole
        flat = self.buffer.reshape(self.size, -1)
        cells = np.arange(flat.shape[1])
        near = flat[(self.head - whole.ravel()) % self.size, cells].reshape(value.shape)
        far = flat[(self.head - whole.ravel() - 1) % self.size, cells].reshape(value.shape)
        return np.where(part > 0, near + part * (far - near), near)
