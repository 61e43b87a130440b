"""The reward of a policy step: `shaped`, this project's own, or `paper`, that of a published experiment.

With p the tip and g the goal in the hole's frame, x = g - p, l the lateral distance, F the largest contact force of
the step, and a the action, each entry within +-1. `shaped`:

    r_d = -|x| / d0                                   (1)  falls evenly from far away
    r_l = -(1 - exp(-(l / l0)^2 / 2))                 (2)  sharp near the axis, where (1) is flat
    r   = 0.5 r_d + 0.25 r_l - 0.2 (F / F0)^2 + 5 [success] - 5 [abort]   (3)

Every step costs, so that finishing early pays; the force term costs little below 10 N. `paper` is equations (1) to (4)
of Kaspar and Bock, "Reinforcement Learning with Cartesian Commands and Sim to Real Transfer for Peg in Hole Tasks":

    r = -(0.1 |x|_2 + 0.9 |x|_1) - 0.0005 sum_i a_i^2 + 50 [success]   (4)

with x in metres. The paper names no unit. In metres a whole episode 9 cm from the goal costs 50 * 0.13 = 6.5, so that
the bonus of 50 shows in the return, as the paper says of its Fig. 3; in millimetres it would cost 6500 and the bonus
would be lost in it. The norm |x|_1 depends on axes, which are the hole's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

L0, F0 = 0.002, 40.0  # m, N
ALPHA, BETA, GAMMA = 0.1, 0.9, 0.0005  # 1/m, 1/m, 1


@dataclass(frozen=True)
class Moment:
    """What a reward is given for.

    Attributes:
        tip: (n, 3) in the hole's frame, m.
        goal: (3,) there, m.
        force: (n,) largest contact force of the step, N.
        action: (n, k), each entry within +-1.
        scale: d0, m.
    """

    tip: np.ndarray
    goal: np.ndarray
    force: np.ndarray
    action: np.ndarray
    scale: float


@dataclass(frozen=True)
class Reward:
    """A reward: `dense` (n,) of every step, and what an episode's end adds."""

    dense: Callable[[Moment], np.ndarray]
    success: float
    abort: float


def shaped(m: Moment) -> np.ndarray:
    """Equation (3) without its events, (n,)."""
    d = np.linalg.norm(m.tip - m.goal, axis=1)  # (1)
    lateral = np.hypot(m.tip[:, 0], m.tip[:, 1])
    r_l = np.exp(-0.5 * (lateral / L0) ** 2) - 1.0  # (2)
    return -0.5 * d / m.scale + 0.25 * r_l - 0.2 * np.minimum(m.force / F0, 3.0) ** 2


def paper(m: Moment) -> np.ndarray:
    """Equation (4) without its bonus, (n,)."""
    x = m.goal - m.tip
    position = ALPHA * np.linalg.norm(x, axis=1) + BETA * np.abs(x).sum(axis=1)
    return -position - GAMMA * np.square(m.action).sum(axis=1)


REWARDS = {"shaped": Reward(shaped, success=5.0, abort=-5.0), "paper": Reward(paper, success=50.0, abort=0.0)}
