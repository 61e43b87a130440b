"""Named terms of observations other than images, each computed from a robot's measurements.

A task's own term is registered here too (`enrol`), so that it can be computed on a robot, without the simulator.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from vispeg.control.laws import rotation_vector
from vispeg.core.errors import UserError

if TYPE_CHECKING:
    from vispeg.interface.observer import Observer, Stack

LIMIT = 20.0  # policies get scaled values clipped to +-LIMIT
NEAR = 0.03  # m, scale of positions relative to the goal
# keys of an observation: scaled terms for the policy, ground truth, and readings in SI units
POLICY, PRIVILEGED, MEASURED = "policy", "privileged", "measured"
FELT = ("force", "torque")  # terms that need a force sensor at the wrist


@dataclass(frozen=True)
class Sensed:
    """One observation term.

    Attributes:
        name: of the term, unique.
        read: function from an Observer of n robots to the term's values (n, size), in `unit`.
        size: number of values; 0 stands for the number of directions in which the policy moves.
        unit: unit of the values; 1 for none.
        scale: typical size, in `unit`; policies get `read / scale`.
        about: one line of description.
        turning: whether the term is only for policies that rotate the flange.
    """

    name: str
    read: Callable[[Observer], np.ndarray]
    size: int
    unit: str
    scale: float
    about: str
    turning: bool = False


SENSED: dict[str, Sensed] = {}


def enrol(term: Sensed) -> Sensed:
    """Register a term by its name, and return it. Raises UserError: another term has that name."""
    if SENSED.setdefault(term.name, term) is not term:
        raise UserError("two observation terms share a name", got=term.name)
    return term


for _term in (
    Sensed(
        "tip",
        lambda o: o.tip() - o.believed,
        3,
        "m",
        NEAR,
        "measured tip minus believed goal, base axes",
    ),
    Sensed("velocity", lambda o: o.twist[:, :3], 3, "m/s", 0.1, "of the flange, base axes"),
    Sensed("force", lambda o: o.wrench[:, :3], 3, "N", 20.0, "at the wrist, base axes, without the tool's weight"),
    Sensed("torque", lambda o: o.wrench[:, 3:], 3, "N m", 2.0, "at the wrist, base axes"),
    Sensed("action", lambda o: o.action, 0, "1", 1.0, "the last action"),
    Sensed(
        "turn",
        lambda o: rotation_vector(o.straight, o.turn),
        3,
        "rad",
        0.1,
        "rotation vector of the flange from straight down; only for policies that rotate it",
        turning=True,
    ),
    Sensed(
        "spin",
        lambda o: o.twist[:, 3:],
        3,
        "rad/s",
        0.5,
        "angular velocity of the flange; only for policies that rotate it",
        turning=True,
    ),
):
    enrol(_term)


class Readable(Protocol):
    """What `scaled` needs of a term; `Sensed` and `vispeg.task.terms.Term` have it."""

    @property
    def read(self) -> Callable[[Any], np.ndarray]:
        """Function that reads the term's value, in its unit, from a subject."""
        ...

    @property
    def scale(self) -> float:
        """Value that a policy sees as 1, in the term's unit."""
        ...


def scaled(
    terms: Iterable[Readable], subject: Any, noisy: Callable[[Any, np.ndarray], np.ndarray] = lambda t, value: value
) -> np.ndarray:
    """Return the values of terms, each divided by its scale and not clipped, side by side: (n, sum of sizes).

    Args:
        terms: the terms, in order.
        subject: what their `read` is called with: an Observer for `Sensed`.
        noisy: called with a term and its values (n, size) before scaling; returns them with noise. By default none.
    """
    return np.concatenate([noisy(t, t.read(subject)) / t.scale for t in terms], axis=1)


def policy_part(stack: Stack) -> np.ndarray:
    """Return the part POLICY of an observation: (n, depth * size) float32, clipped to +-LIMIT."""
    return np.clip(stack.flat(), -LIMIT, LIMIT).astype(np.float32)
