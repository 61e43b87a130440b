"""Many worlds' hands driven along one measured path by the measured wrench, in one call of MuJoCo's batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import batch as mjb

from vispeg.contact.path import Path
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import compiled
from vispeg.sim.physics import derive
from vispeg.sim.placement import activate
from vispeg.sim.state import Fields
from vispeg.worlds.world import World

STATE = mujoco.mjtState
CONTROL = int(STATE.mjSTATE_CTRL | STATE.mjSTATE_QFRC_APPLIED)


@dataclass(frozen=True)
class Driven:
    """What came of it.

    Attributes:
        correction: (nworld, n, 6) wrench in the flange's axes that held the hand on its path, beside the one read; NaN
            outside the windows.
        zero: (nworld, 6) what the sensor read at rest in free air more than the tool weighs.
        place: (nworld, n, 6) how the hands went.
    """

    correction: np.ndarray
    zero: np.ndarray
    place: np.ndarray


def drive(
    scene: Scene,
    path: Path,
    worlds: Sequence[World],
    wrench: np.ndarray,
    rest: slice,
    windows: Sequence[slice],
    nthread: int,
) -> Driven:
    """Drives the hands of `worlds` (which have the same springs built in) through windows of a path.

    Args:
        scene: a hand, see `vispeg.contact.hand`.
        path: measured.
        worlds: with effects of contact and tool alone.
        wrench: (nworld, n, 6) what each world takes for the wrench on the tool, flange axes.
        rest: of the path's samples: those in free air at its start, from which the sensor's zero is taken.
        windows: of the path's samples, in their order.
        nthread: of the batch.
    """
    active = activate(scene, worlds)
    model = compiled(scene, (a.effect.name for a in active))
    batch = mjb.Batch(model, len(worlds), nthread=nthread)
    fields = Fields(batch, scene)
    for a in active:
        a.effect.write(fields, a.p)
    batch.expand("opt.timestep")[:] = path.step
    body = model.body(scene.base).id
    batch.expand("body_pos")[:, body], batch.expand("body_quat")[:, body] = path.origin, path.frame
    derive(batch, fields)
    qpos, qvel, bias = batch.bind("qpos"), batch.bind("qvel"), batch.bind("qfrc_bias")
    qpos[:, :6], qvel[:, :6] = path.place[0], path.rate[0]
    batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
    weight = np.linalg.solve(path.jacobian[0], bias[:, :6].T).T
    zero = wrench[:, rest].mean(axis=1) - weight
    applied = np.einsum("nij,wnj->wni", path.jacobian, wrench - zero[:, None])
    correction, places = np.full(wrench.shape, np.nan), np.tile(path.place, (len(worlds), 1, 1))
    for window in windows:  # what is no joint of the hand's own goes on where the last window left it
        qpos[:, :6], qvel[:] = path.place[window.start], 0.0
        qvel[:, :6] = path.rate[window.start]
        n = window.stop - window.start
        control = np.zeros((len(worlds), n, 12 + model.nv))
        control[:, :, :6], control[:, :, 6:12] = path.place[window], path.rate[window]
        control[:, :, 12:18] = applied[:, window]
        out = batch.rollout(n, control, CONTROL, record=["actuator_force", "qpos"])
        force = out["actuator_force"][:, :, :6] + out["actuator_force"][:, :, 6:12]
        correction[:, window] = np.linalg.solve(path.jacobian[None, window], force[..., None])[..., 0]
        places[:, window] = out["qpos"][:, :, :6]
    return Driven(correction, zero, places)
