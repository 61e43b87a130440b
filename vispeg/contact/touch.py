"""Decide whether recordings are of contact: with a wrench, or one that joint torques can estimate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import flange_pose
from vispeg.task.belief import recorded_cell

HIGHER = 3e-3  # m by which a surface may be higher than it is believed to be, as far as an offset of the goal is tried
SENSORS = ("joint", "motor")


def has_wrench(recordings: Sequence[Recording]) -> bool:
    """Return whether all recordings have a wrench: a measured one, or one that joint torques can estimate.

    Estimates count only if at least one recording without a wrench touches the cell.

    Raises:
        UserError: a recording with contact has neither wrench nor joint torques nor frames.
    """
    without = [rec for rec in recordings if rec.ft is None]
    touched = [rec for rec in without if touches(rec, recorded_cell(rec).scene)]
    for rec in touched:
        if rec.frames is None:
            refuse_without_torques(rec)
    return not without or (bool(touched) and all(map(torqued, without)))


def torqued(rec: Recording) -> bool:
    """Return whether joint torques were recorded."""
    return rec.tau is not None and rec.torque_sensor in SENSORS and bool(np.isfinite(rec.tau).any())


def refuse_without_torques(rec: Recording) -> None:
    """Raise UserError if a recording of contact without a wrench has no joint torques either."""
    if not torqued(rec):
        raise UserError(
            "touches the cell, but has neither a wrench nor joint torques to estimate it",
            file=rec.path / "recording.yaml",
            key="ft.*",
            expected="columns ft.fx .. ft.tz (N, N m), or tau.* and torque_sensor: joint or motor",
        )


def touches(rec: Recording, scene: Scene) -> bool:
    """Return whether the tip came so close to the fixture or the table that it may have touched."""
    pose = flange_pose(scene.nominal, rec.q)
    w, x, y, z = pose[:, 3:].T
    flange_z = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    tip = pose[:, :3] + scene.tip * flange_z - scene.target
    over = np.abs(tip[:, :2]).max(axis=1) < scene.config.block + scene.config.diameter
    height = np.where(over, tip[:, 2], tip[:, 2] + scene.target[2])  # m, above the goal's mouth or the table (z = 0)
    return bool(np.any(height < HIGHER))
