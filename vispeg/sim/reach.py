"""Solve inverse kinematics of the flange: damped least squares for many arms at once."""

from __future__ import annotations

import numpy as np

from vispeg.control.laws import rotation_vector
from vispeg.sim.nominal import Nominal


def reach(
    nominal: Nominal, pos: np.ndarray, quat: np.ndarray, start: np.ndarray, iterations: int = 15, damping: float = 1e-4
) -> tuple[np.ndarray, np.ndarray]:
    """Solve for joint angles by damped least squares (Wampler, IEEE Trans. SMC 16(1), 1986), less damped in each step.

    Args:
        nominal: evaluator with as many rows as there are poses.
        pos: (n, 3) flange position in the base, m.
        quat: (n, 4) flange orientation wxyz.
        start: (n, nj) rad.
        iterations: fixed number of steps, so that a row's result does not depend on the other rows.
        damping: squared damping factor of the first step.

    Returns:
        q (n, nj) in rad, and the norm of the remaining pose error (n,), m and rad together.
    """
    q, error = start.copy(), np.zeros((len(start), 6))
    for _ in range(iterations):
        _, jac, now, turned, _ = nominal.operational(q)
        error = np.concatenate([pos - now, rotation_vector(turned, quat)], axis=1)
        normal = jac @ np.swapaxes(jac, 1, 2) + damping * np.eye(6)
        q = q + np.einsum("nij,ni->nj", jac, np.linalg.solve(normal, error[..., None])[..., 0])
        damping *= 0.3
    return q, np.linalg.norm(error, axis=1)
