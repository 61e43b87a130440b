"""Track one row's episode and classify how it ends."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

import numpy as np

TOUCH = 0.5  # N, contact force above which a contact counts


@dataclass
class Track(ABC):
    """The course of one episode, from which it is classified; each task defines its own categories.

    Attributes:
        touched: whether there has been contact.
        peak: greatest contact force so far, N.
        lateral: present distance of the tip from the goal's axis, m.
        forces: contact forces at the control ticks of each policy step, N.
        depths: depth of the tip below the goal's plane after every policy step, m.
    """

    touched: bool = False
    peak: float = 0.0
    lateral: float = 0.0
    forces: list[np.ndarray] = field(default_factory=list)
    depths: list[float] = field(default_factory=list)

    def add(self, config: Any, forces: np.ndarray, tip: np.ndarray, **observed: float) -> None:
        """Record one policy step.

        Args:
            config: the task's settings.
            forces: (ticks,) contact forces at its control ticks, N.
            tip: (3,) m in the goal's frame.
            observed: see `Task.observed`.
        """
        self.lateral = float(np.hypot(tip[0], tip[1]))
        self.touched |= bool(forces.max() > TOUCH)
        self.peak = max(self.peak, float(forces.max()))
        self.forces.append(forces)
        self.depths.append(float(-tip[2]))

    @abstractmethod
    def verdict(self, config: Any) -> str | None:
        """Return the category if the episode has ended by itself (by success or failure), else None."""

    @abstractmethod
    def at_time(self, config: Any) -> str:
        """Return the category of an episode that ran out of time."""
