"""Excitation of each joint by a motion: friction, inertia, gravity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PARAMETERS: tuple[str, ...] = ("coulomb", "viscous", "inertia", "gravity_sin", "gravity_cos", "bias")
UNITS = ("N m", "N m s/rad", "kg m^2", "N m", "N m", "N m")
MOVES = 0.02  # of the peak speed: below it a joint counts as standing
LEAST_SPEED = 1e-3  # rad/s
BLOCK = 1 << 17  # rows of the regressor that are in memory at once


@dataclass(frozen=True)
class Excitation:
    """How one joint was moved, and what that can tell.

    Attributes:
        range: largest minus smallest angle, rad.
        peak_speed: rad/s.
        reversals: changes of direction, counted once the joint moves on at 2 % of its peak speed.
        moving: share of the time at more than 2 % of the peak speed.
        speed_spread: 90th over 10th percentile of the speed while moving; 1 cannot tell viscous from dry friction.
        condition: condition number of the regressor [sign(dq), dq, ddq, sin q, cos q, 1], columns scaled to unit norm;
            None for a joint that did not move.
        identifiability: parameter -> share of its column that no other column explains, 0 to 1.
        sigma: parameter -> 1-sigma that white torque noise leaves on it in this recording alone (unit as UNITS);
            None where there is no torque.
    """

    range: float
    peak_speed: float
    reversals: int
    moving: float
    speed_spread: float
    condition: float | None
    identifiability: dict[str, float]
    sigma: dict[str, float] | None


def excitation(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, noise_tau: float | None = None) -> Excitation:
    """Judges the motion of one joint on its own; coupling to other joints is not looked at.

    Args:
        q, dq, ddq: (n,) rad, rad/s, rad/s^2, smoothed; NaN where missing.
        noise_tau: 1-sigma of the joint's torque, N m.
    """
    good = np.isfinite(q) & np.isfinite(dq) & np.isfinite(ddq)
    q, dq, ddq = q[good], dq[good], ddq[good]
    if len(q) < 2:
        return Excitation(0.0, 0.0, 0, 0.0, 1.0, None, dict.fromkeys(PARAMETERS, 0.0), None)
    peak = float(np.abs(dq).max())
    moving = np.abs(dq) > max(MOVES * peak, LEAST_SPEED)
    speed = np.abs(dq[moving])
    spread = float(np.quantile(speed, 0.9) / np.quantile(speed, 0.1)) if len(speed) else 1.0
    turns = int(np.sum(np.diff(np.sign(dq[moving])) != 0))
    condition, identifiability, sigma = None, dict.fromkeys(PARAMETERS, 0.0), None
    if len(speed) > len(PARAMETERS):
        condition, partial, norms = _judge(q, dq, ddq)
        identifiability = dict(zip(PARAMETERS, (partial / norms).tolist(), strict=True))
        if noise_tau is not None:
            sigma = {
                k: float(noise_tau / o) if o > 0 else float("inf") for k, o in zip(PARAMETERS, partial, strict=True)
            }
    return Excitation(float(np.ptp(q)), peak, turns, float(moving.mean()), spread, condition, identifiability, sigma)


def regressor(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """(n, 6): torque of one joint per unit of PARAMETERS."""
    return np.stack([np.sign(dq), dq, ddq, np.sin(q), np.cos(q), np.ones_like(q)], axis=1)


def _judge(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> tuple[float | None, np.ndarray, np.ndarray]:
    """Condition number of the regressor's scaled columns, the norm of each column's own part, and of each column.

    A column's own part is what no other spans: 1 / sqrt(diag((A'A)^-1)), so noise / norm is the least-squares standard
    deviation. The triangle of A = QR has A's singular values, and grows block by block.
    """
    triangle = np.zeros((0, len(PARAMETERS)))
    for start in range(0, len(q), BLOCK):
        part = slice(start, start + BLOCK)
        triangle = np.linalg.qr(np.concatenate([triangle, regressor(q[part], dq[part], ddq[part])]), mode="r")
    norms = np.linalg.norm(triangle, axis=0)
    if not np.all(norms > 0):
        return None, np.zeros(len(PARAMETERS)), np.maximum(norms, 1e-300)
    _, s, vt = np.linalg.svd(triangle / norms, full_matrices=False)
    if s[-1] < 1e-12 * s[0]:
        return None, np.zeros(len(PARAMETERS)), norms
    partial = 1.0 / np.sqrt(np.sum((vt / s[:, None]) ** 2, axis=0))
    return float(s[0] / s[-1]), partial * norms, norms
