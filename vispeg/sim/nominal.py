"""Evaluate the nominal model's gravity, inertia and flange kinematics in batches, as controllers need them."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import mujoco
import numpy as np
from mujoco import batch as mjb

DISABLE = mujoco.mjtDisableBit
UNUSED = int(  # features that do not enter gravity, inertia or kinematics
    DISABLE.mjDSBL_CONSTRAINT
    | DISABLE.mjDSBL_CONTACT
    | DISABLE.mjDSBL_SPRING
    | DISABLE.mjDSBL_DAMPER
    | DISABLE.mjDSBL_ACTUATION
    | DISABLE.mjDSBL_SENSOR
)


class Nominal:
    """Nominal quantities at given joint angles, one row per simulation.

    Args:
        model: compiled nominal model (declared tool included).
        joints: joint names, in the order of all joint arrays.
        flange: name of the flange site.
        nsim: number of rows.
        nthread: number of threads.
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
        """Return the gravity torque (nsim, nj) N m at joint angles q (nsim, nj) rad; the next call may overwrite it."""
        self.qpos[:, self.qadr] = q
        self.qvel[:] = 0.0
        self.batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
        return self.bias[:, self.vadr]

    def operational(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return the quantities of operational space control at joint angles q (n, nj) rad.

        Returns:
            Inertia (n, nj, nj) kg m^2, Jacobian (n, 6, nj) m/rad above rad/rad, flange position (n, 3) m and quaternion
            (n, 4) wxyz in the base frame, and gravity torque (n, nj) N m.
        """
        if not hasattr(self, "inputs"):
            self._bind()
        self.gravity(q)
        n, nj = len(self.qpos), len(self.dofs)
        out = np.empty((n, nj, nj)), np.empty((n, 6, nj)), np.empty((n, 3)), np.empty((n, 4)), np.empty((n, nj))
        self.evaluate(*self.inputs, *out)
        return out

    def _bind(self) -> None:
        """Set the kernel of `operational`, its `inputs`, and `dofs`, the dof addresses of the joints."""
        from vispeg.kernels.arm import operational

        self.evaluate, model, bind = operational, self.batch.model, self.batch.bind
        self.dofs = np.arange(self.nv)[self.vadr]
        number = dense(model, 1.0 + np.arange(len(model.M_colind))[None])[0]  # index of each element + 1, or 0
        place = number[np.ix_(self.dofs, self.dofs)].astype(int) - 1  # (nj, nj) indices in M, -1: none
        carriers, body = set(), self.body
        while body:
            carriers, body = carriers | {body}, int(model.body_parentid[body])
        moves = np.array([int(b) in carriers for b in model.dof_bodyid[self.dofs]])  # dofs that move the flange
        states = bind("M"), bind("cdof"), bind("site_xpos"), bind("subtree_com"), bind("xquat"), self.bias
        root = int(model.body_rootid[self.body])
        self.inputs = (*states, place, self.dofs, moves, model.site_quat[self.site].copy(), self.site, root, self.body)


def columns(ids: Sequence[int] | np.ndarray) -> slice | np.ndarray:
    """Return ids as an index of array columns: a slice if they are consecutive, which avoids copies."""
    where = np.asarray(ids, int)
    if len(where) and np.array_equal(where, np.arange(where[0], where[0] + len(where))):
        return slice(int(where[0]), int(where[0]) + len(where))
    return where


def dense(model: mujoco.MjModel, sparse: np.ndarray) -> np.ndarray:
    """Return full symmetric inertia (n, nv, nv) from MuJoCo's lower-triangular CSR values (n, nM)."""
    full = np.zeros((len(sparse), model.nv, model.nv))
    row = np.repeat(np.arange(model.nv), model.M_rownnz)
    col = model.M_colind[: len(row)]
    full[:, row, col] = sparse
    full[:, col, row] = sparse
    return full
