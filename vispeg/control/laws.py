"""Joint impedance, operational space control and avoidance of joint limits, vectorised over simulations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

LOST = 1e-9  # share of the largest eigenvalue of J M^-1 J' below which a direction counts as singular
WORST = 0.1 / LOST  # condition number below which no direction is singular
ZONE = 0.1  # share of a joint's range, at either end, in which the spring acts


def position(
    q_cmd: np.ndarray, dq_cmd: np.ndarray, q: np.ndarray, dq: np.ndarray, kp: np.ndarray, kd: np.ndarray
) -> np.ndarray:
    """Joint impedance `kp (q_cmd - q) + kd (dq_cmd - dq)`, all (nsim, nj); N m."""
    return kp * (q_cmd - q) + kd * (dq_cmd - dq)


def rotation_vector(measured: np.ndarray, commanded: np.ndarray) -> np.ndarray:
    """Rotation vector (n, 3) in the base frame from measured to commanded orientation, both quaternions (n, 4) wxyz.

    The quaternion logarithm of `commanded * conj(measured)`, on the short way round.
    """
    from vispeg.kernels.arm import turns

    if measured.shape != commanded.shape:
        measured, commanded = np.broadcast_arrays(measured, commanded)
    out = np.empty((len(measured), 3))
    turns(measured, commanded, out)
    return out


def turned(quat: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Quaternions (n, 4) wxyz turned by rotation vectors (n, 3) rad given in the base frame."""
    angle = np.linalg.norm(vector, axis=1, keepdims=True)
    axis = vector / np.maximum(angle, 1e-12)
    w1, v1 = np.cos(angle / 2), axis * np.sin(angle / 2)
    w0, v0 = quat[:, :1], quat[:, 1:]
    return np.concatenate(
        [w1 * w0 - np.sum(v1 * v0, axis=1, keepdims=True), w1 * v0 + w0 * v1 + np.cross(v1, v0)], axis=1
    )


def rotated(quat: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) or (3,) of frames turned by quaternions (n, 4) wxyz, in the base frame."""
    w, v = quat[:, :1], quat[:, 1:]
    half = np.cross(v, vector) + w * vector
    return vector + 2.0 * np.cross(v, half)


def task_inertia(mass: np.ndarray, jac: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`Lambda = (J M^-1 J')^-1` (n, m, m) and `M^-1 J'` (n, nv, m).

    Directions lost at a singularity (eigenvalues of J M^-1 J' under `LOST` of the largest) get no task inertia
    instead of an infinite one, so no torque is asked for along them.
    """
    minv_jt = np.linalg.solve(mass, np.swapaxes(jac, 1, 2))  # (n, nv, m)
    return _inverse(jac @ minv_jt), minv_jt


def _inverse(core: np.ndarray) -> np.ndarray:
    """Pseudo-inverse (n, m, m) of symmetric matrices; the plain inverse where no eigenvalue can be under the cut-off:
    the product of a matrix's trace and its inverse's bounds its condition from above.
    """
    try:
        out = np.linalg.inv(core)
    except np.linalg.LinAlgError:  # some row is exactly singular: invert each row separately
        if len(core) > 1:
            return np.concatenate([_inverse(matrix[None]) for matrix in core])
        return np.linalg.pinv(core, rcond=LOST, hermitian=True)
    condition = np.einsum("nii->n", core) * np.einsum("nii->n", out)
    plain = (condition > 0) & (condition < WORST)
    if not plain.all():
        for i in np.flatnonzero(~plain & np.isfinite(condition)):
            out[i] = np.linalg.pinv(core[i], rcond=LOST, hermitian=True)
    return out


def hold_pose(
    state: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    dq: np.ndarray,
    pos: np.ndarray,
    rot: np.ndarray,
    kp: np.ndarray,
    kd: np.ndarray,
    pull: np.ndarray | None,
    force_limit: float | np.ndarray | None,
) -> np.ndarray:
    """Torque (n, nv) N m towards a flange pose, without gravity; see `osc`. Policies and recordings share it.

    Args:
        state: the nominal arm's inertia, Jacobian, flange position and quaternion, and gravity there.
        dq: (n, nv) rad/s.
        pos, rot: (n, 3) m, (n, 4) w x y z: the commanded pose.
        kp, kd: (n, 6), 1/s^2 and 1/s.
        pull: (n, nv) rad/s^2, acceleration of the posture task in the null space.
        force_limit: N, see `osc`.
    """
    from vispeg.kernels.arm import hold

    limit = np.atleast_1d(np.asarray(np.inf if force_limit is None else force_limit, float))
    task = (*state[:4], dq, pos, rot, kp, kd)
    tau, done = np.empty_like(dq), np.empty(len(dq), bool)
    hold(*task, dq[:0] if pull is None else pull, limit, WORST, tau, done)
    if not done.all():
        left = ~done
        some = None if pull is None else pull[left]
        tau[left] = _careful([part[left] for part in task], some, limit[left] if len(limit) > 1 else limit)
    return tau


def _careful(task: Sequence[np.ndarray], pull: np.ndarray | None, limit: np.ndarray) -> np.ndarray:
    """Compute `hold_pose` with `osc`, for rows that are near a singularity or not finite."""
    mass, jac, now, turned, dq, pos, rot, kp, kd = task
    error = np.concatenate([pos - now, rotation_vector(turned, rot)], axis=1)
    twist = np.matmul(jac, dq[:, :, None])[:, :, 0]
    posture = None if pull is None else np.matmul(mass, pull[:, :, None])[:, :, 0]
    return osc(error, twist, mass, jac, kp, kd, posture, force_limit=limit)


def osc(
    error: np.ndarray,
    twist: np.ndarray,
    mass: np.ndarray,
    jac: np.ndarray,
    kp: np.ndarray,
    kd: np.ndarray,
    posture: np.ndarray | None = None,
    force_limit: float | np.ndarray | None = None,
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
        force_limit: greatest norm of the commanded force (first three components), N, one or (n,).

    Returns:
        (n, nv) N m.
    """
    lam, minv_jt = task_inertia(mass, jac)
    force = np.matmul(lam, (kp * error - kd * twist)[:, :, None])[:, :, 0]
    if force_limit is not None:
        linear = force[:, :3]
        norm = np.sqrt(np.einsum("ni,ni->n", linear, linear))
        linear *= np.minimum(1.0, force_limit / np.maximum(norm, 1e-12))[:, None]
    if posture is None:
        return np.matmul(force[:, None], jac)[:, 0]
    # Jbar' tau_0 = Lambda J M^-1 tau_0
    force -= np.matmul(np.matmul(posture[:, None], minv_jt), lam)[:, 0]
    return np.matmul(force[:, None], jac)[:, 0] + posture


def away(q: np.ndarray, limits: np.ndarray, stiffness: float) -> np.ndarray:
    """Return the joint acceleration (n, nj) rad/s^2 away from the limits (nj, 2) rad; q (n, nj) rad, stiffness 1/s^2.

    It is the negative gradient of a potential as Khatib's (Int. J. Robotics Research 5(1), 1986, section 6): 0 outside
    the zones at either end, but `stiffness / 2` times the squared depth inside, so that the pull begins at 0 and stays
    finite beyond the limit. A joint without limits has no zones.
    """
    low, high = limits.T
    bounded = np.isfinite(low) & np.isfinite(high)
    low, high = np.where(bounded, low, 0.0), np.where(bounded, high, 0.0)
    zone = ZONE * (high - low)
    return stiffness * bounded * (np.maximum(low + zone - q, 0.0) - np.maximum(q - high + zone, 0.0))


def singular(jac: np.ndarray) -> np.ndarray:
    """Smallest singular value (n,) of flange Jacobians (n, 6, nj), in m/rad and rad/rad together; 0 at a singularity.

    It is the least speed of the flange, in any direction, that joint speeds of unit norm give: Klein and Blaho, Int. J.
    Robotics Research 6(2), 1987. Lengths count in metres: a turn of 1 rad weighs as much as a way of 1 m.
    """
    return np.linalg.svd(jac, compute_uv=False)[:, -1]
