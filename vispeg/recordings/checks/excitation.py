"""Measure how well a joint's motion determines its friction, inertia, gravity torque and torque offset."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PARAMETERS: tuple[str, ...] = ("coulomb", "viscous", "inertia", "gravity_sin", "gravity_cos", "bias")
UNITS = ("N m", "N m s/rad", "kg m^2", "N m", "N m", "N m")
SLOW = 0.02  # share of the peak speed up to which a joint counts as standing
LEAST_SPEED = 1e-3  # rad/s, speed up to which a joint always counts as standing
COLLINEAR = 1e-12  # share of a column's norm below which its own part is rounding
BLOCK = 1 << 17  # rows of the regressor that are in memory at once


@dataclass(frozen=True)
class Excitation:
    """How one joint was moved, and which parameters that motion determines.

    Attributes:
        range: largest minus smallest angle, rad.
        peak_speed: rad/s.
        reversals: changes of direction between samples at which the joint `moves`.
        moving: share of the samples at which it does.
        speed_spread: 90th over 10th percentile of the speed while moving; at 1, viscous and dry friction are
            confounded.
        condition: condition number of the regressor [sign(dq), dq, ddq, sin q, cos q, 1], columns scaled to unit norm;
            infinite if it is singular, None for a joint that hardly moved.
        identifiability: parameter -> norm of the part of its column that no combination of the others gives, over the
            column's norm: 0, not determined, to 1.
        sigma: parameter -> standard deviation of its estimate from this recording alone, due to white torque noise
            (unit as UNITS); infinite if it is not determined, None where the noise is not known, or the joint hardly
            moved.
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
    """Examine the motion of one joint by itself, without its coupling to other joints.

    Args:
        q, dq, ddq: (n,) rad, rad/s, rad/s^2, smoothed; NaN where missing.
        noise_tau: 1-sigma noise of the joint's torque, N m; None if it is not known.
    """
    good = np.isfinite(q) & np.isfinite(dq) & np.isfinite(ddq)
    q, dq, ddq = q[good], dq[good], ddq[good]
    if len(q) < 2:
        return Excitation(0.0, 0.0, 0, 0.0, 1.0, None, dict.fromkeys(PARAMETERS, 0.0), None)
    peak = float(np.abs(dq).max())
    moving = moves(dq)
    speed = np.abs(dq[moving])
    spread = float(np.quantile(speed, 0.9) / np.quantile(speed, 0.1)) if len(speed) else 1.0
    turns = int(np.sum(np.diff(np.sign(dq[moving])) != 0))
    condition, identifiability, sigma = None, dict.fromkeys(PARAMETERS, 0.0), None
    if len(speed) > len(PARAMETERS):
        condition, own, norms = _determined(q, dq, ddq)
        identifiability = dict(zip(PARAMETERS, own.tolist(), strict=True))
        if noise_tau is not None:
            sigma = {
                k: float(noise_tau / norm) if norm > 0 else float("inf")
                for k, norm in zip(PARAMETERS, own * norms, strict=True)
            }
    return Excitation(float(np.ptp(q)), peak, turns, float(moving.mean()), spread, condition, identifiability, sigma)


def moves(dq: np.ndarray) -> np.ndarray:
    """Return whether a joint moves, (n,) bool, at speeds `dq` (n,) rad/s: faster than SLOW and LEAST_SPEED say."""
    speed = np.abs(dq)
    return speed > max(SLOW * speed.max(initial=0.0), LEAST_SPEED)


def regressor(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Return the regressor (n, 6): the joint's torque per unit of each of PARAMETERS."""
    return np.stack([np.sign(dq), dq, ddq, np.sin(q), np.cos(q), np.ones_like(q)], axis=1)


def _determined(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Compute how well the regressor A = [sign(dq), dq, ddq, sin q, cos q, 1] determines each parameter.

    A column's own part is the part that no combination of the other columns gives. The torque noise over its norm is
    the parameter's least-squares standard deviation. A is not kept: the triangle R of A = QR has A's inner products,
    and is updated block by block.

    Returns:
        Condition number of A with columns of norm 1 (infinite if singular), norms of their own parts (6,), and norms
        of A's columns (6,).
    """
    triangle = np.zeros((0, len(PARAMETERS)))
    for start in range(0, len(q), BLOCK):
        part = slice(start, start + BLOCK)
        triangle = np.linalg.qr(np.concatenate([triangle, regressor(q[part], dq[part], ddq[part])]), mode="r")
    norms = np.linalg.norm(triangle, axis=0)
    unit = triangle / np.maximum(norms, 1e-300)
    own = np.zeros(len(PARAMETERS))
    for k, column in enumerate(unit.T):
        others = np.delete(unit, k, axis=1)
        size = np.linalg.norm(column - others @ np.linalg.lstsq(others, column, rcond=COLLINEAR)[0])
        own[k] = size if size > COLLINEAR else 0.0
    s = np.linalg.svd(unit, compute_uv=False)
    return float(s[0] / s[-1]) if s[-1] > COLLINEAR * s[0] else float("inf"), own, norms
