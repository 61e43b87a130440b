"""Joint impedance, operational space control and avoidance of joint limits, vectorised over simulations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

LOST = 1e-9  # share of the largest eigenvalue of J M^-1 J' below which a direction counts as singular
WORST = 0.1 / LOST  # condition number below which no direction is singular, with a margin of 10
ZONE = 0.1  # share of a joint's range, at either end, in which the spring acts


def position(
    q_cmd: np.ndarray, dq_cmd: np.ndarray, q: np.ndarray, dq: np.ndarray, kp: np.ndarray, kd: np.ndarray
) -> np.ndarray:
    """Return the torque (nsim, nj) N m of joint impedance: `kp (q_cmd - q) + kd (dq_cmd - dq)`.

    All arguments are (nsim, nj), or broadcast to that: rad, rad/s, N m/rad and N m s/rad.
    """
    return kp * (q_cmd - q) + kd * (dq_cmd - dq)


def rotation_vector(measured: np.ndarray, commanded: np.ndarray) -> np.ndarray:
    """Return the rotation vector (n, 3) rad, base frame, from measured to commanded orientation, (n, 4) wxyz each.

    It is the quaternion logarithm of `commanded * conj(measured)`, with an angle of at most pi.
    """
    from vispeg.kernels.arm import turns

    if measured.shape != commanded.shape:
        measured, commanded = np.broadcast_arrays(measured, commanded)
    out = np.empty((len(measured), 3))
    turns(measured, commanded, out)
    return out


def turned(quat: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Rotate orientations (n, 4) wxyz by rotation vectors (n, 3) rad in the base frame; return quaternions (n, 4)."""
    angle = np.linalg.norm(vector, axis=1, keepdims=True)
    axis = vector / np.maximum(angle, 1e-12)
    w1, v1 = np.cos(angle / 2), axis * np.sin(angle / 2)
    w0, v0 = quat[:, :1], quat[:, 1:]
    return np.concatenate(
        [w1 * w0 - np.sum(v1 * v0, axis=1, keepdims=True), w1 * v0 + w0 * v1 + np.cross(v1, v0)], axis=1
    )


def rotated(quat: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Return vectors in the base frame, (n, 3), from vectors (n, 3) or (3,) in frames of orientation (n, 4) wxyz."""
    w, v = quat[:, :1], quat[:, 1:]
    half = np.cross(v, vector) + w * vector
    return vector + 2.0 * np.cross(v, half)


def task_inertia(mass: np.ndarray, jac: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the task inertia `Lambda = (J M^-1 J')^-1` (n, m, m), and `M^-1 J'` (n, nv, m).

    Directions that are lost at a singularity (eigenvalues of J M^-1 J' below `LOST` times the largest) get a task
    inertia of 0 instead of infinity, so that no torque acts along them.
    """
    minv_jt = np.linalg.solve(mass, np.swapaxes(jac, 1, 2))  # (n, nv, m)
    return _inverse(jac @ minv_jt), minv_jt


def _inverse(core: np.ndarray) -> np.ndarray:
    """Return the pseudo-inverse (n, m, m) of symmetric matrices.

    It is the plain inverse if no eigenvalue can be below the cut-off. This is decided by the trace of the matrix times
    that of its inverse, which is an upper bound of its condition number.
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
    """Return the torque (n, nv) N m towards a flange pose, without gravity; see `osc`. Tasks and recordings share it.

    Args:
        state: of the nominal arm: inertia (n, nv, nv), Jacobian (n, 6, nv), flange position (n, 3) and quaternion
            (n, 4), gravity (n, nv); see `vispeg.sim.nominal.Nominal.operational`.
        dq: (n, nv) rad/s.
        pos, rot: commanded pose in the base, (n, 3) m and (n, 4) wxyz.
        kp, kd: (n, 6) gains, 1/s^2 and 1/s.
        pull: (n, nv) rad/s^2, acceleration of the posture task in the null space; None for no such task.
        force_limit: N, see `osc`; None for no limit.
    """
    from vispeg.kernels.arm import hold

    limit = np.atleast_1d(np.asarray(np.inf if force_limit is None else force_limit, float))
    task = (*state[:4], dq, pos, rot, kp, kd)
    tau, done = np.empty_like(dq), np.empty(len(dq), bool)
    no_pull = dq[:0]  # the kernel takes an array: an empty one for no posture task
    hold(*task, no_pull if pull is None else pull, limit, WORST, tau, done)
    if not done.all():
        undone = ~done
        undone_pull = None if pull is None else pull[undone]
        undone_limit = limit[undone] if len(limit) > 1 else limit
        tau[undone] = _careful([part[undone] for part in task], undone_pull, undone_limit)
    return tau


def _careful(task: Sequence[np.ndarray], pull: np.ndarray | None, limit: np.ndarray) -> np.ndarray:
    """Compute `hold_pose` with `osc`, for rows that are near a singularity or not finite."""
    mass, jac, pos_now, rot_now, dq, pos, rot, kp, kd = task
    error = np.concatenate([pos - pos_now, rotation_vector(rot_now, rot)], axis=1)
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
    """Compute the torque of Khatib's operational space law, without Coriolis terms and gravity.

    `tau = J' F + (1 - J' Jbar') tau_0`, `F = Lambda (kp e - kd v)`. Source: IEEE J. Robotics and Automation 3(1), 1987,
    eqs. 17-20.

    Args:
        error: (n, 6) position error (m), then rotation vector (rad), base frame.
        twist: (n, 6) linear and angular velocity of the flange, m/s and rad/s.
        mass: (n, nv, nv) joint-space inertia, kg m^2.
        jac: (n, 6, nv) flange Jacobian, base frame.
        kp, kd: (n, 6) gains, 1/s^2 and 1/s.
        posture: (n, nv) null-space torque tau_0, N m; None for 0.
        force_limit: greatest norm of the commanded force (first three components of F), N, one or (n,); None for no
            limit.

    Returns:
        Torque (n, nv) N m.
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
    """Return the joint acceleration (n, nj) rad/s^2 that pulls joints away from their limits.

    It is the negative gradient of a potential similar to Khatib's (Int. J. Robotics Research 5(1), 1986, section 6).
    The potential is 0 except in a zone at either end of a joint's range, where it is `stiffness / 2` times the squared
    depth in the zone. So the pull begins at 0 and stays finite beyond the limit. A joint without limits has no zones.

    Args:
        q: (n, nj) joint angles, rad.
        limits: (nj, 2) lower and upper limits, rad.
        stiffness: 1/s^2.
    """
    low, high = limits.T
    bounded = np.isfinite(low) & np.isfinite(high)
    low, high = np.where(bounded, low, 0.0), np.where(bounded, high, 0.0)
    zone = ZONE * (high - low)
    return stiffness * bounded * (np.maximum(low + zone - q, 0.0) - np.maximum(q - high + zone, 0.0))


def singular(jac: np.ndarray) -> np.ndarray:
    """Return the smallest singular value (n,) of flange Jacobians (n, 6, nj); it is 0 at a singularity.

    It is the least speed of the flange, over all its directions, for joint speeds of unit norm (Klein and Blaho, Int.
    J. Robotics Research 6(2), 1987). Metres and radians count alike: a rotation of 1 rad weighs as much as a
    displacement of 1 m.
    """
    return np.linalg.svd(jac, compute_uv=False)[:, -1]
