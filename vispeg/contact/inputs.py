"""Inputs of the contact comparison: the nominal cell, the wrench in flange axes, and its episodes in blocks."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.contact.hand import Grasp
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
    """A recording of contact.

    Attributes:
        recording: with measured angles.
        scene: the cell as the user believes it.
        believed: effects that are part of that belief.
        wrench: (n, 6) N, N m: what the flange puts on the tool, flange axes.
        torques: its estimate from joint torques if there was no sensor; None if there was.
    """

    recording: Recording
    scene: Scene
    wrench: np.ndarray
    believed: World = field(default_factory=World)
    torques: External | None = None


@dataclass(frozen=True, kw_only=True)
class ContactItem(Item):
    """One episode: two channels, force and torque, three columns each, one row per block.

    Attributes:
        path, phase: of the flange, and its contact.
        source: the recording.
        hand, grasp: what is driven along the path, and its springs.
        answer: (6, m, 6), see `vispeg.contact.items.displaced`.
        response: (m, 6, 6), see `vispeg.contact.items.pushed`.
    """

    path: Path
    phase: Phases
    source: Touching
    hand: Scene
    grasp: Grasp
    answer: np.ndarray
    response: np.ndarray

    @property
    def nj(self) -> int:
        """Axes."""
        return 3

    @property
    def period(self) -> float:
        """Time between blocks, s."""
        return RULES.contact_block


def touching(rec: Recording) -> Touching:
    """Return a recording of contact; without a recorded wrench, with one estimated from joint torques.

    Raises:
        UserError: neither a wrench nor joint torques were recorded, or a cell that cannot be built.
    """
    cell = recorded_cell(rec)
    if rec.ft is None or not sensed(rec):
        rec, torques = estimated(rec, cell.scene)
        return Touching(rec, cell.scene, torques.wrench, cell.world, torques)
    sensor = rec.wrench or WrenchSensor()
    turn = Rotation.from_quat(flange_pose(cell.scene.nominal, bridged(rec.time, rec.q))[:, 3:], scalar_first=True)
    wrench = canonical(rec.ft, sensor, turn.as_matrix())
    if sensor.tared == "weight":
        wrench = wrench + _weight(cell.scene, turn)
    return Touching(rec, cell.scene, wrench, cell.world)


def _weight(scene: Scene, turn: Rotation) -> np.ndarray:
    """Return the wrench (n, 6) that holds the tool at rest in these orientations, flange axes.

    The robot subtracted it from its readings.
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
