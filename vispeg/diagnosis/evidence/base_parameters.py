"""Benchmark of a torque diagnosis: linear least squares over all links' inertial parameters, friction and bias.

Torque along a measured motion is linear in a link's mass, mass times centre, and inertia about the link's frame, so the
best rigid arm with Coulomb and viscous friction, rotor inertia and bias in every joint is one linear fit. No arm of
that form fits the fitted recordings better; its held-out error is the mark for a diagnosis. Its parameters are not a
model, since most are not identifiable one by one, and masses may be negative. Source: Gautier and Khalil, IEEE
Transactions on Robotics and Automation 6(3), 1990, on base parameters: the identifiable combinations.
"""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco import batch as mjb

from vispeg.identify.channels import Item
from vispeg.identify.inverse import STICK, TorqueEvidence
from vispeg.sim.compiled import compiled
from vispeg.sim.nominal import dense
from vispeg.sim.state import Fields
from vispeg.worlds.world import World

RANK = 1e-4  # times the greatest singular value of the scaled columns: below it a direction counts as undetermined
QUARTER = np.array([[np.cos(np.pi / 8), *(np.sin(np.pi / 8) * e)] for e in np.eye(3)])  # 45 degrees about x, y, z


def base_parameters(fitted: TorqueEvidence, held_out: TorqueEvidence, world: World) -> list[np.ndarray]:
    """Return for each held-out item the residual (m, nj) N m after a fit of all base parameters in addition to `world`.

    The fit is on the fitted recordings. Invalid samples are 0.
    """
    x, y = _system(fitted, world)
    scale = np.maximum(np.linalg.norm(x, axis=0), 1e-12)
    solution = np.linalg.lstsq(x / scale, y, rcond=RANK)[0] / scale
    out = []
    for item, residual in zip(held_out.items, _residuals(held_out, world), strict=True):
        remaining = residual - (columns(item) @ solution).reshape(residual.shape)
        out.append(np.where(item.valid, remaining, 0.0))
    return out


def _system(evidence: TorqueEvidence, world: World) -> tuple[np.ndarray, np.ndarray]:
    """Return columns (n, k) and residual (n,) of all valid samples."""
    parts = [
        (columns(item)[item.valid.ravel()], residual[item.valid])
        for item, residual in zip(evidence.items, _residuals(evidence, world), strict=True)
    ]
    return np.concatenate([x for x, _ in parts]), np.concatenate([y for _, y in parts])


def _residuals(evidence: TorqueEvidence, world: World) -> list[np.ndarray]:
    pairs = zip(evidence.items, evidence.simulated([world]), strict=True)
    return [np.nan_to_num(item.measured) - y[0] for item, y in pairs]


def columns(item: Item) -> np.ndarray:
    """Return the derivatives (m nj, 10 nlink + 4 nj) of the joint torques along an item's motion.

    They are by ten inertial states of each link, then by Coulomb and viscous friction, rotor inertia and bias of each
    joint.
    """
    seg, nj = item.segment, item.nj
    ddq = seg.cache["ddq"]
    rigid = _rigid(item, ddq)  # (m, nj, 10 nlink)
    each = np.stack([np.tanh(seg.dq / STICK), seg.dq, ddq, np.ones_like(seg.dq)], axis=2)  # (m, nj, 4)
    joint_columns = np.einsum("njk,ji->njik", each, np.eye(nj)).reshape(len(ddq), nj, -1)
    return np.concatenate([rigid, joint_columns], axis=2).reshape(len(ddq) * nj, -1)


def _rigid(item: Item, ddq: np.ndarray) -> np.ndarray:
    """Return (m, nj, 10 nlink): torques of each link alone in ten mass states that span its inertial parameters.

    They are along the motion of an item with the accelerations `ddq` (m, nj).
    """
    model, seg = compiled(item.robot), item.segment
    rows, out = len(seg.time), []
    batch = mjb.Batch(model, rows, nthread=1)
    fields = Fields(batch, item.robot)
    mass, com = fields["body_mass"], fields["body_ipos"]
    inertia, turn, rotor = fields["body_inertia"], fields["body_iquat"], fields["dof_armature"]
    batch.bind("qpos")[:, fields.qposes], batch.bind("qvel")[:, fields.dofs] = seg.q, seg.dq
    bias, matrix = batch.bind("qfrc_bias"), batch.bind("M")
    mass[:], inertia[:], rotor[:] = 0.0, 0.0, 1.0  # a rotor of 1 keeps the inertia matrix regular

    def torque() -> np.ndarray:
        batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
        v = fields.dofs
        return np.einsum("nij,nj->ni", dense(model, matrix)[:, v][:, :, v], ddq) + bias[:, v]

    nothing = torque()
    for body in fields.links:
        # 0: a unit mass at the link's frame, 1 to 3: 1 m from it along x, y, z; 4 to 6: a unit inertia about x, y, z,
        # 7 to 9: about axes turned by 45 degrees
        for k in range(10):
            mass[:, body] = float(k < 4)
            com[:, body] = np.eye(3)[k - 1] if 1 <= k < 4 else 0.0
            inertia[:, body] = np.eye(3)[(k - 4) % 3] if k >= 4 else 0.0
            turn[:, body] = QUARTER[(k - 6) % 3] if k >= 7 else (1.0, 0.0, 0.0, 0.0)
            out.append(torque() - nothing)
        mass[:, body], inertia[:, body] = 0.0, 0.0
    return np.stack(out, axis=2)
