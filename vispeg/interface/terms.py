"""Named observation terms other than images, each computed from a robot's measurements.

A term of a task's own is enrolled here too, so that it can be built off the simulator.
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

LIMIT = 20.0  # largest scaled value
NEAR = 0.03  # m, a unit of positions near the goal
# keys of an observation: what a policy may see, the ground truth, and readings as a robot's driver has them
POLICY, PRIVILEGED, MEASURED = "policy", "privileged", "measured"
FELT = ("force", "torque")  # terms that a robot without a sensor at its wrist cannot tell


@dataclass(frozen=True)
class Sensed:
    """One term.

    Attributes:
        name: by which it is found.
        read: observer -> (n, size), in `unit`.
        size: numbers; 0 for one a direction that the policy moves.
        unit: of what `read` gives.
        scale: in `unit`; an observation holds `read / scale`, near 1.
        about: one line for people.
        turning: whether only policies that turn the flange are told it.
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
    """Make a term known by its name. Raises UserError where another has it."""
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
        "measured tip less where the goal is believed to be, base axes",
    ),
    Sensed("velocity", lambda o: o.twist[:, :3], 3, "m/s", 0.1, "of the flange, base axes"),
    Sensed("force", lambda o: o.wrench[:, :3], 3, "N", 20.0, "at the wrist, base axes, tool's weight off"),
    Sensed("torque", lambda o: o.wrench[:, 3:], 3, "N m", 2.0, "at the wrist, base axes"),
    Sensed("action", lambda o: o.action, 0, "1", 1.0, "the last action"),
    Sensed(
        "turn",
        lambda o: rotation_vector(o.straight, o.turn),
        3,
        "rad",
        0.1,
        "rotation vector of the flange from straight down; of policies that turn it",
        turning=True,
    ),
    Sensed(
        "spin",
        lambda o: o.twist[:, 3:],
        3,
        "rad/s",
        0.5,
        "angular velocity of the flange; of policies that turn it",
        turning=True,
    ),
):
    enrol(_term)


class Readable(Protocol):
    """A term as `scaled` needs it: one of these, or of a task's (`vispeg.task.terms.Term`)."""

    @property
    def read(self) -> Callable[[Any], np.ndarray]: ...  # noqa: D102
    @property
    def scale(self) -> float: ...  # noqa: D102


def scaled(
    terms: Iterable[Readable], subject: Any, noisy: Callable[[Any, np.ndarray], np.ndarray] = lambda t, value: value
) -> np.ndarray:
    """(n, d) scaled values of terms, read from what they are read from; `noisy` adds to one in its unit."""
    return np.concatenate([noisy(t, t.read(subject)) / t.scale for t in terms], axis=1)


def told(stack: Stack) -> np.ndarray:
    """Return the part POLICY of an observation: (n, depth size) float32 within +-LIMIT."""
    return np.clip(stack.flat(), -LIMIT, LIMIT).astype(np.float32)
