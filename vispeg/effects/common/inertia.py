"""Changes of a body's inertial parameters, per simulation, in MuJoCo's form: principal inertias and their axes."""

from __future__ import annotations

import numpy as np

from vispeg.core.rotation import quaternion


def tensor(fields, body: int) -> np.ndarray:
    """Return the inertia (nsim, 3, 3) about the centre of mass, body axes, kg m^2."""
    rot = rotation(fields["body_iquat"][:, body])
    return np.einsum("nij,nj,nkj->nik", rot, fields["body_inertia"][:, body], rot)


def add_ball(fields, body: int, mass: np.ndarray, point: np.ndarray, radius: np.ndarray) -> None:
    """Add a ball of `mass` (nsim,) kg and `radius` (nsim,) m at `point` (nsim, 3) m in the body frame."""
    rows = mass != 0
    if not rows.any():
        return
    m0, c0 = fields["body_mass"][rows, body], fields["body_ipos"][rows, body]
    total = m0 + mass[rows]
    com = (m0[:, None] * c0 + mass[rows, None] * point[rows]) / total[:, None]
    inertia = tensor(fields, body)[rows] + parallel(m0, c0 - com) + parallel(mass[rows], point[rows] - com)
    inertia += (0.4 * mass[rows] * radius[rows] ** 2)[:, None, None] * np.eye(3)
    value, axes = np.linalg.eigh(inertia)
    axes *= np.sign(np.linalg.det(axes))[:, None, None]  # a rotation, not a reflection
    fields["body_mass"][rows, body] = total
    fields["body_ipos"][rows, body] = com
    fields["body_inertia"][rows, body] = np.maximum(value, 1e-9)
    fields["body_iquat"][rows, body] = quaternion(axes)


def parallel(mass: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return the parallel-axis term `m (d.d 1 - d d')`, (n, 3, 3) kg m^2, for a shift d (n, 3) m."""
    return mass[:, None, None] * (np.sum(d * d, 1)[:, None, None] * np.eye(3) - d[:, :, None] * d[:, None, :])


def rotation(quat: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (n, 3, 3) of unit quaternions (n, 4) wxyz."""
    w, x, y, z = quat.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
