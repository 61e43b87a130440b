"""The nominal model's gravity, inertia and flange kinematics for many arms at once: what controllers know."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import mujoco
import numpy as np
from mujoco import batch as mjb

DISABLE = mujoco.mjtDisableBit
UNUSED = int(  # none of it enters gravity, inertia or kinematics
    DISABLE.mjDSBL_CONSTRAINT
    | DISABLE.mjDSBL_CONTACT
    | DISABLE.mjDSBL_SPRING
    | DISABLE.mjDSBL_DAMPER
    | DISABLE.mjDSBL_ACTUATION
    | DISABLE.mjDSBL_SENSOR
)


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
        model = copy(model)
        model.opt.disableflags |= UNUSED
        self.batch = mjb.Batch(model, nsim, nthread=nthread)
        self.nv = model.nv
        self.qadr = columns([model.joint(j).qposadr[0] for j in joints])
        self.vadr = columns([model.joint(j).dofadr[0] for j in joints])
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
            self._bind()
        gravity = self.gravity(q).copy()
        pos = self.xpos[:, self.site].copy()
        mass = np.take(self.mass, self.entry, axis=1, mode="clip")
        if self.sparse is not None:
            mass *= self.sparse
        return mass, self._jacobian(pos), pos, self._quat(), gravity

    def _bind(self) -> None:
        model = self.batch.model
        self.mass, self.cdof = self.batch.bind("M"), self.batch.bind("cdof")
        self.xpos, self.xquat = self.batch.bind("site_xpos"), self.batch.bind("xquat")
        self.com, self.root = self.batch.bind("subtree_com"), int(model.body_rootid[self.body])
        dofs = np.arange(self.nv)[self.vadr]
        place = dense(model, 1.0 + np.arange(len(model.M_colind))[None])[0][np.ix_(dofs, dofs)].astype(int) - 1
        self.entry = np.maximum(place, 0)
        self.sparse = None if place.min() >= 0 else (place >= 0).astype(float)
        above, body = set(), self.body
        while body:
            above, body = above | {body}, int(model.body_parentid[body])
        moves = np.array([int(b) in above for b in model.dof_bodyid[dofs]])
        self.still = None if moves.all() else np.flatnonzero(~moves)
        turn = model.site_quat[self.site]
        self.turn = None if np.array_equal(turn, [1, 0, 0, 0]) else times(turn)

    def _jacobian(self, pos: np.ndarray) -> np.ndarray:
        """(n, 6, nj) at the point (n, 3) of the flange's body, from the joints' screws as `mj_jac` has it."""
        screw = self.cdof[:, self.vadr]  # (n, nj, 6): rotation, then translation at the tree's centre of mass
        ax, ay, az = screw[:, :, 0], screw[:, :, 1], screw[:, :, 2]
        arm = (pos - self.com[:, self.root])[:, :, None]
        jac = np.empty((len(pos), 6, screw.shape[1]))
        jac[:, 0] = screw[:, :, 3] + (ay * arm[:, 2] - az * arm[:, 1])
        jac[:, 1] = screw[:, :, 4] + (az * arm[:, 0] - ax * arm[:, 2])
        jac[:, 2] = screw[:, :, 5] + (ax * arm[:, 1] - ay * arm[:, 0])
        jac[:, 3:] = np.swapaxes(screw[:, :, :3], 1, 2)
        if self.still is not None:
            jac[:, :, self.still] = 0.0
        return jac

    def _quat(self) -> np.ndarray:
        """Flange orientation (n, 4) wxyz, signed as by `mju_mat2Quat`: w is positive above 1/2, else the largest."""
        out = self.xquat[:, self.body]
        if self.turn is not None:
            out = np.matmul(self.turn, out[:, :, None])[:, :, 0]
        size = np.abs(out)
        lead = np.where(size[:, 0] > 0.5, 0, 1 + size[:, 1:].argmax(axis=1))
        return out * np.copysign(1.0, out[np.arange(len(out)), lead])[:, None]


def times(right: np.ndarray) -> np.ndarray:
    """The matrix (4, 4) that multiplies a quaternion wxyz by the unit quaternion `right` from the right."""
    w, x, y, z = right
    return np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])


def columns(ids: Sequence[int] | np.ndarray) -> slice | np.ndarray:
    """Ids as an index of array columns: a slice where they follow each other, which reads and writes without copies."""
    where = np.asarray(ids, int)
    if len(where) and np.array_equal(where, np.arange(where[0], where[0] + len(where))):
        return slice(int(where[0]), int(where[0]) + len(where))
    return where


def dense(model: mujoco.MjModel, sparse: np.ndarray) -> np.ndarray:
    """Full symmetric inertia (n, nv, nv) from MuJoCo's lower-triangular CSR rows (n, nM)."""
    full = np.zeros((len(sparse), model.nv, model.nv))
    row = np.repeat(np.arange(model.nv), model.M_rownnz)
    col = model.M_colind[: len(row)]
    full[:, row, col] = sparse
    full[:, col, row] = sparse
    return full
