"""Inverse dynamics of a model: the torques that its links, springs, dampers and the medium need for a motion."""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np
from mujoco import batch as mjb

from vispeg.sim.compiled import BATCH
from vispeg.sim.nominal import columns, dense


class InverseDynamics:
    """Evaluate the dynamics of a model at many states. Forces of constraints are not counted, see `uncounted`.

    Args:
        model: compiled model.
        joints: joint names, in the order of all joint arrays; other joints stay at their initial position.
    """

    def __init__(self, model: mujoco.MjModel, joints: tuple[str, ...]):
        self.model = model
        self.qadr = columns([model.joint(j).qposadr[0] for j in joints])
        self.vadr = columns([model.joint(j).dofadr[0] for j in joints])
        self._batch = lru_cache(maxsize=2)(lambda n: mjb.Batch(model, n, nthread=1))  # full blocks, and the last

    def torque(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Return the torques (n, nj) N m for a motion (n, nj) in rad, rad/s and rad/s^2."""
        mass, bias = self.terms(q, dq)
        return bias + np.einsum("nij,nj->ni", mass, ddq)

    def terms(self, q: np.ndarray, dq: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return inertia (n, nj, nj) kg m2 and bias torque (n, nj) N m at n states, rad and rad/s.

        Bias is gravity, centrifugal and Coriolis torque, less the passive torque of springs, dampers and the medium.
        """
        mass, bias = np.empty((*q.shape, q.shape[1])), np.empty_like(q)
        for start in range(0, len(q), BATCH):
            block = slice(start, start + BATCH)
            batch = self._batch(len(q[block]))
            batch.bind("qpos")[:, self.qadr], batch.bind("qvel")[:, self.vadr] = q[block], dq[block]
            total, passive, inertia = (batch.bind(name) for name in ("qfrc_bias", "qfrc_passive", "M"))
            batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
            mass[block] = dense(self.model, inertia)[:, self.vadr][:, :, self.vadr]
            bias[block] = (total - passive)[:, self.vadr]
        return mass, bias


def uncounted(model: mujoco.MjModel) -> list[str]:
    """Return the couplings, equalities, and limits and friction of tendons in a model, which `InverseDynamics` lacks.

    It lacks the limits and the dry friction of joints too; `identify.inverse` adds the friction.
    """
    out = []
    for i in np.flatnonzero(model.eq_active0):
        of_joint = model.eq_type[i] == mujoco.mjtEq.mjEQ_JOINT
        ids = [int(j) for j in (model.eq_obj1id[i], model.eq_obj2id[i]) if j >= 0] if of_joint else []
        ends = " and ".join(model.joint(j).name for j in ids)
        out.append(f"coupling of {ends}" if ends else f"equality {model.equality(i).name or i + 1}")
    for i in np.flatnonzero(model.tendon_limited.astype(bool) | (model.tendon_frictionloss > 0)):
        out.append(f"limit or friction of tendon {model.tendon(i).name or i + 1}")
    return out
