"""The cell as a test bench: a batch of scenes with effects, the arm held or driven at a prescribed joint velocity."""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np
from mujoco import batch as mjb

from vispeg.robots.scene import build
from vispeg.sim.compiled import compiled
from vispeg.sim.placement import activate
from vispeg.sim.state import Fields
from vispeg.worlds.world import World

SCENE = build()
SLIP = 7  # the peg's slide comes after the arm's joints
CLAMP = 1e7  # kg m^2, armature that no contact can move
BESIDE = (0.63, 0.0)  # m, where the peg stands on the fixture's top beside its hole
TOP = 0.05  # m, height of the fixture's top
G = 9.81


@lru_cache
def pose(x: float, y: float, z: float) -> np.ndarray:
    """Joint angles (7,) at which the peg points straight down with its tip at (x, y, z) m, by Gauss-Newton."""
    model = compiled(SCENE)
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0.6, 0, -1.4, 0, 1.1, 0]
    tip, jac = model.site("peg_tip").id, np.zeros((6, model.nv))
    for _ in range(60):
        mujoco.mj_fwdPosition(model, data)
        mat = data.site_xmat[tip].reshape(3, 3)
        error = np.r_[np.array([x, y, z]) - data.site_xpos[tip], np.cross(mat[:, 2], [0, 0, -1])]
        mujoco.mj_jacSite(model, data, jac[:3], jac[3:], tip)
        data.qpos[:7] += np.linalg.pinv(jac[:, :7], rcond=1e-3) @ error
    assert np.abs(error).max() < 1e-9
    return data.qpos[:7].copy()


def written(worlds: list[World], scene=SCENE) -> tuple[mjb.Batch, Fields]:
    """Return a batch with the worlds' effects written into its fields, as the simulation does."""
    active = activate(scene, worlds)
    batch = mjb.Batch(compiled(scene, (a.effect.name for a in active)), len(worlds), nthread=1)
    fields = Fields(batch, scene)
    for a in active:
        a.effect.write(fields, a.p)
    if fields.touched:
        batch.set_const()
    return batch, fields


def bench(worlds: list[World], tip, h: float, velocity=(0.0, 0.0, 0.0), loose: bool = True) -> mjb.Batch:
    """Return a batch with the arm clamped to a straight path: the tip at `tip` (3,) m, moving at `velocity` (3,) m/s.

    Args:
        loose: the peg falls freely along its axis, with neither grip nor damping; else it is held as nominal.
    """
    batch, _ = written(worlds)
    model = batch.model
    batch.expand("opt.timestep")[:] = h
    batch.expand("dof_armature")[:, :7] = CLAMP
    batch.expand("opt.tolerance")[:] = 0.0  # it is relative to the mean inertia, which the clamp makes huge
    batch.expand("dof_damping")[:, SLIP] -= model.dof_damping[SLIP]  # what is nominal; an effect's stays
    if loose:
        batch.expand("dof_frictionloss")[:, SLIP] = 0.0
    q = pose(*tip)
    batch.bind("qpos")[:, :7] = q
    data, jac = mujoco.MjData(model), np.zeros((6, model.nv))
    data.qpos[:7] = q
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_jacSite(model, data, jac[:3], jac[3:], model.site("peg_tip").id)
    batch.bind("qvel")[:, :7] = np.linalg.pinv(jac[:, :7]) @ np.r_[velocity, 0, 0, 0]
    return batch


def contact_force(batch: mjb.Batch, row: int) -> np.ndarray:
    """Force (3,) in N on the peg from everything it touches, world axes."""
    model, data = batch.get_model(row), batch.get_data(row)
    mujoco.mj_forward(model, data)
    peg, total, wrench = model.geom("peg").id, np.zeros(3), np.zeros(6)
    for i in range(data.ncon):
        c = data.contact[i]
        if peg in (c.geom1, c.geom2):
            mujoco.mj_contactForce(model, data, i, wrench)
            total += (1 if c.geom2 == peg else -1) * wrench[:3] @ c.frame.reshape(3, 3)
    return total
