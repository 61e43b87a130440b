"""The nominal model's gravity, inertia and flange kinematics for many arms at once: what controllers know."""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco import batch as mjb


class Nominal:
    """Nominal quantities at given joint angles, one row a simulation.

    Args:
        model: compiled nominal model (declared tool included).
        joints: joint names, in the order of all joint arrays.
        flange: name of the flange site.
        nsim: rows.
        nthread: threads.
    """

    def __init__(self, model: mujoco.MjModel, joints: tuple[str, ...], flange: str, nsim: int, nthread: int):
        self.batch = mjb.Batch(model, nsim, nthread=nthread)
        self.nv = model.nv
        self.qadr = np.array([model.joint(j).qposadr[0] for j in joints])
        self.vadr = np.array([model.joint(j).dofadr[0] for j in joints])
        self.site = model.site(flange).id
        self.body = int(model.site_bodyid[self.site])
        self.qpos, self.qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self.bias = self.batch.bind("qfrc_bias")

    def gravity(self, q: np.ndarray) -> np.ndarray:
        """Gravity torque (nsim, nj) in N m at q (nsim, nj)."""
        self.qpos[:, self.qadr] = q
        self.qvel[:] = 0.0
        self.batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
        return self.bias[:, self.vadr]

    def operational(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Inertia (n, nj, nj), Jacobian (n, 6, nj), flange position (n, 3) and quaternion (n, 4), gravity (n, nj)."""
        if not hasattr(self, "mass"):
            self.mass = self.batch.bind("M")
            self.xpos, self.xmat = self.batch.bind("site_xpos"), self.batch.bind("site_xmat")
        gravity = self.gravity(q).copy()
        pos = self.xpos[:, self.site].copy()
        jacp, jacr = self.batch.jac(self.body, pos)
        jac = np.concatenate([jacp, jacr], axis=1)[:, :, self.vadr]
        return (
            dense(self.batch.model, self.mass)[:, self.vadr][:, :, self.vadr],
            jac,
            pos,
            quat(self.xmat[:, self.site]),
            gravity,
        )


def dense(model: mujoco.MjModel, sparse: np.ndarray) -> np.ndarray:
    """Full symmetric inertia (n, nv, nv) from MuJoCo's lower-triangular CSR rows (n, nM)."""
    full = np.zeros((len(sparse), model.nv, model.nv))
    row = np.repeat(np.arange(model.nv), model.M_rownnz)
    col = model.M_colind[: len(row)]
    full[:, row, col] = sparse
    full[:, col, row] = sparse
    return full


def quat(mat: np.ndarray) -> np.ndarray:
    """Unit quaternions (n, 4) wxyz from rotation matrices (n, 9) or (n, 3, 3).

    The greatest of the four components by its square, the others from sums and differences of off-diagonal entries
    (Shepperd, J. Guidance and Control 1(3), 1978); its sign is positive, as `mju_mat2Quat` has it.
    """
    m = np.reshape(mat, (-1, 3, 3))
    xx, yy, zz = m[:, 0, 0], m[:, 1, 1], m[:, 2, 2]
    x, y, z = m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]
    xy, xz, yz = m[:, 0, 1] + m[:, 1, 0], m[:, 0, 2] + m[:, 2, 0], m[:, 1, 2] + m[:, 2, 1]
    rows = np.stack(  # 4 w (w, x, y, z), 4 x (w, x, y, z), ...: each a multiple of the quaternion
        [
            np.stack([1 + xx + yy + zz, x, y, z], axis=1),
            np.stack([x, 1 + xx - yy - zz, xy, xz], axis=1),
            np.stack([y, xy, 1 - xx + yy - zz, yz], axis=1),
            np.stack([z, xz, yz, 1 - xx - yy + zz], axis=1),
        ],
        axis=1,
    )
    k = np.where(xx + yy + zz > 0, 0, 1 + np.argmax(np.stack([xx, yy, zz]), axis=0))
    out = rows[np.arange(len(m)), k]
    return out / np.linalg.norm(out, axis=1, keepdims=True)
