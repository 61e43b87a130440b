"""The nominal arm in NumPy: where its flange is, the joints that bring it there, and its inertia there.

Only the published table is shared with the joint benchmark (`hidden_effects/arm.py`); no MuJoCo, no code of the model.
"""

from __future__ import annotations

import numpy as np
from arm import FLANGE, LINKS

HOME = np.array([0.0, 0.6, 0.0, -1.6, 0.0, 0.95, 0.0])  # rad, where the search for joint angles starts


def matrix(quat: np.ndarray) -> np.ndarray:
    """Return rotations (..., 3, 3) of quaternions (..., 4) wxyz of any length."""
    w, x, y, z = np.moveaxis(quat / np.linalg.norm(quat, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def quaternion(rot: np.ndarray) -> np.ndarray:
    """Return quaternions (n, 4) wxyz of rotations (n, 3, 3), by the largest of the four components."""
    d = np.stack(
        [
            1 + rot[:, 0, 0] + rot[:, 1, 1] + rot[:, 2, 2],
            1 + rot[:, 0, 0] - rot[:, 1, 1] - rot[:, 2, 2],
            1 - rot[:, 0, 0] + rot[:, 1, 1] - rot[:, 2, 2],
            1 - rot[:, 0, 0] - rot[:, 1, 1] + rot[:, 2, 2],
        ],
        axis=1,
    )
    s = rot - np.swapaxes(rot, 1, 2)
    t = rot + np.swapaxes(rot, 1, 2)
    forms = np.stack([
        np.stack([d[:, 0], s[:, 2, 1], s[:, 0, 2], s[:, 1, 0]], axis=1),
        np.stack([s[:, 2, 1], d[:, 1], t[:, 0, 1], t[:, 0, 2]], axis=1),
        np.stack([s[:, 0, 2], t[:, 0, 1], d[:, 2], t[:, 1, 2]], axis=1),
        np.stack([s[:, 1, 0], t[:, 0, 2], t[:, 1, 2], d[:, 3]], axis=1),
    ])  # fmt: skip
    q = forms[np.argmax(d, axis=1), np.arange(len(rot))]
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def turn(vector: np.ndarray) -> np.ndarray:
    """Return rotations (n, 3, 3) by rotation vectors (n, 3), rad (Rodrigues)."""
    angle = np.linalg.norm(vector, axis=1)[:, None, None]
    k = cross_matrix(vector)
    a = np.where(angle > 1e-9, np.sin(angle) / np.maximum(angle, 1e-12), 1.0)
    b = np.where(angle > 1e-9, (1 - np.cos(angle)) / np.maximum(angle, 1e-12) ** 2, 0.5)
    return np.eye(3) + a * k + b * (k @ k)


def cross_matrix(v: np.ndarray) -> np.ndarray:
    """Return matrices (n, 3, 3) with `cross_matrix(v) @ x = v x x`."""
    out = np.zeros((len(v), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    return out - np.swapaxes(out, 1, 2)


def rotation_vector(rot: np.ndarray) -> np.ndarray:
    """Return rotation vectors (n, 3), rad, of rotations (n, 3, 3) of less than half a turn."""
    v = np.stack([rot[:, 2, 1] - rot[:, 1, 2], rot[:, 0, 2] - rot[:, 2, 0], rot[:, 1, 0] - rot[:, 0, 1]], axis=1)
    sine = 0.5 * np.linalg.norm(v, axis=1, keepdims=True)
    angle = np.arctan2(sine, 0.5 * (np.trace(rot, axis1=1, axis2=2) - 1)[:, None])
    return 0.5 * v * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-12), 1.0)


def forward(q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return flange position (n, 3) m, rotation (n, 3, 3) and Jacobian (n, 6, 7) in the base, of angles (n, 7) rad."""
    pos, rot, axes, at = _chain(q)
    tip = pos + rot @ FLANGE
    jac = np.stack([np.concatenate([np.cross(z, tip - p), z], axis=1) for z, p in zip(axes, at, strict=True)], axis=2)
    return tip, rot, jac


def _chain(q: np.ndarray):
    n = len(q)
    pos, rot = np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1))
    axes, at = [], []
    for i, (offset, quat, *_) in enumerate(LINKS):
        pos = pos + rot @ np.array(offset, float)
        rot = rot @ matrix(np.array(quat, float))
        axes.append(rot[:, :, 2].copy())
        at.append(pos)
        c, s = np.cos(q[:, i]), np.sin(q[:, i])
        rot = np.stack([rot[:, :, 0] * c[:, None] + rot[:, :, 1] * s[:, None],
                        rot[:, :, 1] * c[:, None] - rot[:, :, 0] * s[:, None], rot[:, :, 2]], axis=2)  # fmt: skip
    return pos, rot, axes, at


def joints(pos: np.ndarray, rot: np.ndarray, steps: int = 12) -> np.ndarray:
    """Return joint angles (n, 7) rad at flange poses (n, 3) m, (n, 3, 3): Newton's steps of least norm from HOME.

    All samples start from the same angles, so that the elbow moves smoothly along a smooth path.

    Raises:
        ValueError: out of reach.
    """
    q = np.tile(HOME, (len(pos), 1))
    for _ in range(steps):
        here, turned, jac = forward(q)
        error = np.concatenate([pos - here, rotation_vector(rot @ np.swapaxes(turned, 1, 2))], axis=1)
        core = jac @ np.swapaxes(jac, 1, 2) + 1e-10 * np.eye(6)
        q = q + (np.swapaxes(jac, 1, 2) @ np.linalg.solve(core, error[:, :, None]))[:, :, 0]
    if np.abs(forward(q)[0] - pos).max() > 1e-7:
        raise ValueError("the flange's path is out of reach")
    return q


def apparent(q: np.ndarray) -> np.ndarray:
    """Return the bare arm's inertia at the flange, `(J M^-1 J')^-1` at q (7,): (6, 6) kg, kg m, kg m^2."""
    _, _, axes, at = _chain(q[None])
    mass = np.zeros((7, 7))
    for i in range(7):
        spot, frame = _link(q, i)
        m, com, inertia = LINKS[i][2], np.array(LINKS[i][3], float), np.diag(LINKS[i][4])
        centre = spot + frame @ com
        jv = np.zeros((3, 7))
        jw = np.zeros((3, 7))
        for j in range(i + 1):
            jv[:, j], jw[:, j] = np.cross(axes[j][0], centre - at[j][0]), axes[j][0]
        mass += m * jv.T @ jv + jw.T @ frame @ inertia @ frame.T @ jw
    jac = forward(q[None])[2][0]
    return np.linalg.inv(jac @ np.linalg.solve(mass, jac.T))


def _link(q: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray]:
    """Return position (3,) m and rotation (3, 3) of link i's frame."""
    pos, rot = np.zeros(3), np.eye(3)
    for k in range(i + 1):
        offset, quat = LINKS[k][:2]
        pos = pos + rot @ np.array(offset, float)
        c, s = np.cos(q[k]), np.sin(q[k])
        rot = rot @ matrix(np.array(quat, float)) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    return pos, rot
