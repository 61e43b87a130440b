"""Inputs of the contact comparison: a recording with its believed cell and its wrench, and one episode in blocks."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.contact.path import Path
from vispeg.contact.phases import Phases
from vispeg.contact.torques import estimated, sensed
from vispeg.core.rules import RULES
from vispeg.identify.channels import Item
from vispeg.recordings.cell import WrenchSensor, canonical
from vispeg.recordings.differentiate import bridged
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import flange_pose
from vispeg.sim.external import External
from vispeg.task.belief import recorded_cell
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Touching:
    """A recording with a wrench at the wrist, measured or estimated.

    Attributes:
        recording: the recording; its `ft` is the estimate if no wrench was measured.
        scene: the cell that the recording states, without its believed effects.
        wrench: (n, 6) N and N m, wrench of the flange on the tool about the flange's origin, flange axes.
        believed: the effects that the recording states for its cell.
        torques: the estimate from joint torques with its accuracy; None if a wrench was measured.
    """

    recording: Recording
    scene: Scene
    wrench: np.ndarray
    believed: World = field(default_factory=World)
    torques: External | None = None


@dataclass(frozen=True, kw_only=True)
class ContactItem(Item):
    """One episode of a recording, in m blocks of time.

    Its two channels are force and torque, flange axes: three columns each, one row per block.

    Attributes:
        path: measured motion of the flange, resampled to physics steps.
        phase: the blocks, and the phase of contact of each.
        source: the recording.
        armless: the cell without its arm, whose flange is held to the path by springs (`vispeg.contact.hand`).
        path_response: (6, m, 6) N and N m, change of the predicted wrench due to an error of the path: axis of the
            error, block, component; see `vispeg.contact.items.path_response`.
        reading_response: (m, 6, 6), share of a reading error that remains in the residual: block, component of the
            residual, component of the error; see `vispeg.contact.items.reading_response`.
    """

    path: Path
    phase: Phases
    source: Touching
    armless: Scene
    path_response: np.ndarray
    reading_response: np.ndarray

    @property
    def nj(self) -> int:
        """Number of columns of each channel."""
        return 3

    @property
    def period(self) -> float:
        """Duration of a block, s."""
        return RULES.contact_block


def touching(rec: Recording) -> Touching:
    """Return a recording with its cell and its wrench, which is estimated from joint torques if none was recorded.

    Raises:
        UserError: neither a wrench nor joint torques were recorded, or the cell cannot be built.
    """
    cell = recorded_cell(rec)
    if rec.ft is None or not sensed(rec):
        rec, torques = estimated(rec, cell.scene)
        return Touching(rec, cell.scene, torques.wrench, cell.world, torques)
    sensor = rec.wrench or WrenchSensor()
    turn = Rotation.from_quat(
        flange_pose(cell.scene.nominal, bridged(rec.time, rec.q, rec.episode))[:, 3:], scalar_first=True
    )
    wrench = canonical(rec.ft, sensor, turn.as_matrix())
    if sensor.tared == "weight":
        wrench = wrench + _weight(cell.scene, turn)
    return Touching(rec, cell.scene, wrench, cell.world)


def _weight(scene: Scene, turn: Rotation) -> np.ndarray:
    """Return the wrench (n, 6) N and N m that holds tool and held part at rest, flange axes.

    A robot whose readings are tared by `weight` has subtracted it. `turn` holds n rotations from flange to base axes.
    """
    model = scene.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bodies = [model.body(name).id for name in ("tool", scene.held)]
    mass = model.body_mass[bodies]
    site = data.site(scene.flange)
    centre = (mass[:, None] * (data.xipos[bodies] - site.xpos)).sum(axis=0) @ site.xmat.reshape(3, 3) / mass.sum()
    force = -mass.sum() * turn.inv().apply(model.opt.gravity)
    return np.concatenate([force, np.cross(centre, force)], axis=1)
