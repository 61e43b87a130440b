"""Joint impedance and operational space control, vectorised over simulations."""

from __future__ import annotations

import numpy as np


def position(
    q_cmd: np.ndarray, dq_cmd: np.ndarray, q: np.ndarray, dq: np.ndarray, kp: np.ndarray, kd: np.ndarray
) -> np.ndarray:
    """Joint impedance `kp (q_cmd - q) + kd (dq_cmd - dq)`, all (nsim, nj); N m."""
    return kp * (q_cmd - q) + kd * (dq_cmd - dq)


def rotation_vector(measured: np.ndarray, commanded: np.ndarray) -> np.ndarray:
    """Rotation vector (n, 3) in the base frame from measured to commanded orientation, both quaternions (n, 4) wxyz.

    The quaternion logarithm of `commanded * conj(measured)`, on the short way round.
    """
    w1, v1 = commanded[:, :1], commanded[:, 1:]
    w0, v0 = measured[:, :1], -measured[:, 1:]
    w = w1 * w0 - np.sum(v1 * v0, axis=1, keepdims=True)
    v = w1 * v0 + w0 * v1 + np.cross(v1, v0)
    v = np.where(w < 0, -v, v)
    sine = np.linalg.norm(v, axis=1, keepdims=True)
    angle = 2 * np.arctan2(sine, np.abs(w))
    return v * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)


def task_inertia(mass: np.ndarray, jac: np.ndarray, damping: float = 1e-9) -> tuple[np.ndarray, np.ndarray]:
    """`Lambda = (J M^-1 J')^-1` (n, m, m) and `M^-1 J'` (n, nv, m).

    Directions lost at a singularity (eigenvalues of J M^-1 J' under `damping` of the largest) get no task inertia
    instead of an infinite one, so no torque is asked for along them.
    """
    minv_jt = np.linalg.solve(mass, np.swapaxes(jac, 1, 2))  # (n, nv, m)
    core = jac @ minv_jt
    return np.linalg.pinv(core, rcond=damping, hermitian=True), minv_jt


def osc(
    error: np.ndarray,
    twist: np.ndarray,
    mass: np.ndarray,
    jac: np.ndarray,
    kp: np.ndarray,
    kd: np.ndarray,
    posture: np.ndarray | None = None,
    dof: np.ndarray | None = None,
    force_limit: float | None = None,
) -> np.ndarray:
    """Khatib's operational space law (IEEE J. Robotics and Automation 3(1), 1987, eqs. 17-20), no Coriolis, no gravity.

    `tau = J' F + (1 - J' Jbar') tau_0`, `F = Lambda (kp e - kd v)`.

    Args:
        error: (n, 6) position error (m) then rotation vector (rad), base frame.
        twist: (n, 6) linear and angular velocity of the flange, m/s and rad/s.
        mass: (n, nv, nv) joint-space inertia.
        jac: (n, 6, nv) flange Jacobian, base frame.
        kp, kd: (n, 6) gains per unit mass, 1/s^2 and 1/s.
        posture: (n, nv) null-space torque tau_0, N m.
        dof: (6,) bool, the Cartesian directions that are controlled; the others are left free.
        force_limit: greatest norm of the commanded force (first three components), N: a spring that yields on contact.

    Returns:
        (n, nv) N m.
    """
    if dof is not None:
        error, twist, jac, kp, kd = error[:, dof], twist[:, dof], jac[:, dof], kp[:, dof], kd[:, dof]
    lam, minv_jt = task_inertia(mass, jac)
    force = np.einsum("nij,nj->ni", lam, kp * error - kd * twist)
    if force_limit is not None:
        lin = slice(0, 3 if dof is None else int(np.sum(dof[:3])))
        norm = np.linalg.norm(force[:, lin], axis=1, keepdims=True)
        force[:, lin] *= np.minimum(1.0, force_limit / np.maximum(norm, 1e-12))
    tau = np.einsum("nij,ni->nj", jac, force)
    if posture is not None:
        jbar_t = lam @ np.swapaxes(minv_jt, 1, 2)  # (n, m, nv): Lambda J M^-1 = Jbar'
        tau = tau + posture - np.einsum("nij,ni->nj", jac, np.einsum("nij,nj->ni", jbar_t, posture))
    return tau
