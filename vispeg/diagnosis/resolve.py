"""Which channels a model and its recordings have: the one place that says so, for every command, the page and the API.

A channel is one kind of evidence: `joints` (angles in closed loop, or torques by inverse dynamics), `pictures`,
`contact` (the wrench at the wrist), `tosses` (poses of a free object). All recordings must have it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np

from vispeg.core.effect import ARM, OPTICAL, Effect, effect
from vispeg.core.errors import UserError
from vispeg.core.rules import RULES
from vispeg.recordings.recording import Recording
from vispeg.robots.bench import shows
from vispeg.robots.objects import is_object
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import flange_pose
from vispeg.task.belief import bench_of, cell_of, recorded_cell
from vispeg.worlds.world import World

ChannelName = Literal["joints", "contact", "pictures", "tosses"]
SENSORS = ("joint", "motor")


def resolve(
    world: World, *groups: Sequence[Recording], asked: Sequence[ChannelName] = (), key: str = "--channels"
) -> tuple[ChannelName, ...]:
    """Name the channels that a model and recordings are compared in, in the order in which they are diagnosed.

    By default all that they have; but in a task's cell that was not photographed, or where no wrench was felt, the
    joints only where nothing else is there: the arm is stiff and slow in contact, and shows next to nothing there.
    Where they have none it is the joints, whose reader says which column is missing.

    Args:
        world: the model.
        groups: recordings, fitted and held out.
        asked: channels that are wanted; empty for the default.
        key: how the user asked, for errors.

    Raises:
        UserError: a channel asked for that a recording lacks, or a recording of contact without wrench and torques.
    """
    can = available(world, *groups)
    for name in asked:
        if name not in can:
            raise UserError("not all of the recordings have this channel", key=key, got=name, choices=can)
    whole = world.cell is None or {"pictures", "contact"} <= set(can)
    usual: tuple[ChannelName, ...] = can if whole else can[-1:]
    return tuple(name for name in can if name in (asked or usual)) or ("joints",)


def available(world: World, *groups: Sequence[Recording]) -> tuple[ChannelName, ...]:
    """Name the channels that a model and all recordings have; none of the joints' where torques stand for a wrench.

    Raises:
        UserError: a recording of contact without wrench and torques.
    """
    if is_object(world.robot):
        return ("tosses",)
    recordings = [rec for group in groups for rec in group]
    out: list[ChannelName] = []
    touched = world.cell is not None and felt(recordings)  # a tool touches in a task's cell alone
    if not (touched and any(rec.ft is None for rec in recordings)) and all(map(moved, recordings)):
        out.append("joints")
    if photographed(world, *groups):
        out.append("pictures")
    if touched:
        out.append("contact")
    return tuple(out)


def fitted_in(channels: Sequence[ChannelName], effects: Iterable[str]) -> ChannelName:
    """Name the channel of several that a fit of these effects is made to: the first that shows most of them."""
    kinds = [effect(name) for name in effects]
    return max(channels, key=lambda channel: sum(shown_in(channel, kind) for kind in kinds))


def shown_in(channel: ChannelName, kind: Effect) -> bool:
    """Whether a channel is where an effect is looked for."""
    if channel == "pictures":
        return kind.family in OPTICAL or "border" in kind.channels()
    if channel == "contact":
        return "wrench" in kind.channels()
    return kind.family in ARM and kind.searchable


def moved(rec: Recording) -> bool:
    """Whether the joints of a recording can be predicted: under its controller, or from measured torques."""
    return rec.control.mode != "unknown" or (rec.tau is not None and rec.torque_sensor != "none")


def photographed(world: World, *groups: Sequence[Recording]) -> bool:
    """Whether all recordings hold pictures of something that a model knows more of than its arm."""
    recordings = [rec for group in groups for rec in group]
    if not all(rec.frames is not None and len(rec.frames) > 0 for rec in recordings):
        return False
    return all(seen(world, rec) for rec in recordings)


def seen(world: World, rec: Recording) -> bool:
    """Whether a model has something for the cameras of a recording to see."""
    return cell_of(world, rec) is not None or shows(bench_of(world))


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
