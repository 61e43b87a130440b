"""The dense reward of a policy step.

With p the tip and g the goal in the hole's frame, l the lateral distance, F the largest contact force of the step:

    d   = |p - g|                                    (1)
    r_d = -d / d0                                    (2)  falls evenly from far away
    r_l = -(1 - exp(-(l / l0)^2 / 2))                (3)  sharp near the axis, where (2) is flat
    r   = 0.5 r_d + 0.25 r_l - 0.2 (F / F0)^2 + 5 [success] - 5 [abort]   (4)

Every step costs, so that finishing early pays; the force term costs little below 10 N.
"""

from __future__ import annotations

import numpy as np

L0, F0 = 0.002, 40.0  # m, N
BONUS = 5.0


def reward(tip: np.ndarray, goal_depth: float, force: np.ndarray, scale: float) -> np.ndarray:
    """Equation (4) without its events.

    Args:
        tip: (n, 3) tip in the hole's frame, m.
        goal_depth: m below the mouth.
        force: (n,) N.
        scale: d0, m.
    """
    d = np.linalg.norm(tip - np.array([0.0, 0.0, -goal_depth]), axis=1)  # (1)
    lateral = np.hypot(tip[:, 0], tip[:, 1])
    r_l = np.exp(-0.5 * (lateral / L0) ** 2) - 1.0  # (3)
    return -0.5 * d / scale + 0.25 * r_l - 0.2 * np.minimum(force / F0, 3.0) ** 2
