"""Whether recordings are of contact: a wrench was measured, or torques to tell one from while the tip touches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.rules import RULES
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import flange_pose
from vispeg.task.belief import recorded_cell

SENSORS = ("joint", "motor")


def felt(recordings: Sequence[Recording]) -> bool:
    """Whether all of them have a wrench, or those without one touch something and have joint torques to tell it from.

    Raises:
        UserError: one that touches something has neither, nor frames.
    """
    without = [rec for rec in recordings if rec.ft is None]
    touched = [rec for rec in without if touches(rec, recorded_cell(rec).scene)]
    for rec in touched:
        if rec.frames is None:
            refuse_numb(rec)
    return not without or (bool(touched) and all(map(torqued, without)))


def torqued(rec: Recording) -> bool:
    """Whether joint torques were recorded."""
    return rec.tau is not None and rec.torque_sensor in SENSORS and bool(np.isfinite(rec.tau).any())


def refuse_numb(rec: Recording) -> None:
    """Raise UserError for a recording of contact without joint torques, where no wrench was measured either."""
    if not torqued(rec):
        raise UserError(
            "touches the cell and has no wrench, nor joint torques to tell it from",
            file=rec.path / "recording.yaml",
            key="ft.*",
            expected="columns ft.fx .. ft.tz (N, N m), or tau.* and torque_sensor: joint or motor",
        )


def touches(rec: Recording, scene: Scene) -> bool:
    """Whether the tip came so near to the fixture or the table that it may have touched."""
    pose = flange_pose(scene.nominal, rec.q)
    w, x, y, z = pose[:, 3:].T
    out = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    tip = pose[:, :3] + scene.tip * out - scene.target
    over = np.abs(tip[:, :2]).max(axis=1) < scene.config.block + RULES.tip_round
    return bool(np.any(np.where(over, tip[:, 2], tip[:, 2] + scene.target[2]) < RULES.tip_near))
