"""Prepare the episodes of a contact recording for comparison, and predict their wrenches in other worlds.

For a prediction, the cell without its arm is simulated: springs hold its flange to the measured path, the measured
wrench acts on it, and the correction is the wrench that the springs add (`vispeg.contact.drive`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vispeg.contact.beginning import beginnings, episode_numbers, no_free_air, tared
from vispeg.contact.drive import Driven, drive
from vispeg.contact.errors.floors import floors
from vispeg.contact.hand import UNITS
from vispeg.contact.inputs import ContactItem, Touching
from vispeg.contact.path import Path
from vispeg.contact.phases import Phases, nearest
from vispeg.contact.sensor import hand_world, true_per_read, true_wrench
from vispeg.contact.thin import thinned, without
from vispeg.contact.torques import calm
from vispeg.contact.yielding import arm_displacement
from vispeg.core.rules import RULES
from vispeg.identify.channels import Channel
from vispeg.recordings.cell import WrenchSensor
from vispeg.recordings.recording import Control
from vispeg.recordings.regimes import INSIDE, PRESS, REGIMES, SLIDE
from vispeg.robots.scene import Scene
from vispeg.sim.segments.segment import Segment
from vispeg.sim.touch import touch
from vispeg.worlds.world import World

PUSH = 0.2  # N, reading error in `reading_response`


def driven(item: ContactItem, worlds: Sequence[World], nthread: int = 1) -> Driven:
    """Simulate an item's cell without its arm along its path, once for each world.

    Args:
        item: one episode.
        worlds: effects besides the believed ones; all worlds compile to the same model (see `built_alike`).
        nthread: threads of the simulation.
    """
    hand_worlds = [hand_world(item.source.believed, w) for w in worlds]
    wrench = np.stack([true_wrench(item.path, w) for w in hand_worlds])
    return drive(
        item.armless, item.source.scene, item.path, hand_worlds, wrench, item.phase.rest, item.phase.windows, nthread,
        deviation=lambda exerted: arm_displacement(item, hand_worlds, exerted), per_read=_true_per_read(item, worlds),
    )  # fmt: skip


def _true_per_read(item: ContactItem, worlds: Sequence[World]) -> np.ndarray:
    """Return for each world the change of the true force per newton of change in the reading, (nworld,)."""
    hand_worlds = [hand_world(item.source.believed, w) for w in worlds]
    return np.array([true_per_read(item.path, w) for w in hand_worlds])


def path_response(item: ContactItem, nominal: Driven, nthread: int = 1) -> np.ndarray:
    """Return the change of the predicted wrench if the path is off by `kinematics_place` or `kinematics_turn`.

    Args:
        item: one episode.
        nominal: result of driving the believed model along the measured path.
        nthread: threads of the simulation.

    Returns:
        (6, m, 6) N and N m as read: axis of the error (x, y, z, rx, ry, rz of the flange at the path's start; +z points
        out of the flange, so deeper), block, and component of the wrench; 0 in blocks that were not driven.
    """
    off = np.diag(np.repeat([RULES.kinematics_place, RULES.kinematics_turn], 3))
    world = hand_world(item.source.believed, World())
    wrench = np.repeat(true_wrench(item.path, world)[None], 6, axis=0)
    phase, scenes = item.phase, (item.armless, item.source.scene)
    per_read = _true_per_read(item, [World()] * 6)
    out = drive(*scenes, item.path, [world] * 6, wrench, phase.rest, phase.windows, nthread, off, per_read=per_read)
    return np.nan_to_num(phase.means(out.correction) - phase.means(nominal.correction)) / per_read[0]


def reading_response(item: ContactItem, nominal: Driven, nthread: int = 1) -> np.ndarray:
    """Return the share of a constant reading error that remains in the residual.

    In free air the springs must bear a wrong force, so all of the error remains. In contact the surface bears a force
    that presses against it, so little remains. The shares are simulated in the measured phases press, slide and inside;
    in other phases, and in blocks that were not driven, all remains, even if the model is in contact there.

    Args:
        item: one episode.
        nominal: result of driving the believed model along the measured path.
        nthread: threads of the simulation.

    Returns:
        (m, 6, 6): block, component of the residual, component of the wrench that is read too large after the rest.
    """
    size, world = PUSH * UNITS, hand_world(item.source.believed, World())
    wrench = np.repeat(true_wrench(item.path, world)[None], 6, axis=0)
    per_read, phase = _true_per_read(item, [World()] * 6), item.phase
    error = np.zeros_like(wrench)
    error[:, phase.rest.stop :] = (np.diag(size) * per_read[0])[:, None]
    out = drive(
        item.armless, item.source.scene, item.path, [world] * 6, wrench + error, phase.rest, phase.windows, nthread,
        per_read=per_read,
    )  # fmt: skip
    change = (phase.means(nominal.correction) - phase.means(out.correction)) / per_read[0] / size[:, None, None]
    remains = np.moveaxis(change, 0, 2)
    contact = phase.of(REGIMES[PRESS]) | phase.of(REGIMES[SLIDE]) | phase.of(REGIMES[INSIDE])
    return np.where((contact & np.isfinite(remains).all(axis=(1, 2)))[:, None, None], remains, np.eye(6))


def predicted(item: ContactItem, out: Driven, worlds: Sequence[World]) -> np.ndarray:
    """Return the wrench that the sensor would read in each world, (nworld, m, 6) N and N m, flange axes.

    It is the measured wrench plus the correction; in the rest at the start it is the measured wrench minus the sensor's
    zero, so that the residual there is the zero. Both are converted from true forces to readings, for the following
    reason. With readings `y = G w + n` of a wrench w, and a path that is off by e, the residual of readings is
    `n + G K e`, where `drive` sets the stiffness K of the springs proportional to `1 / G`. Its covariance is therefore
    the same in all worlds, and a world whose sensor reads less does not seem to fit better.

    Args:
        item: one episode.
        out: result of `driven` for these worlds.
        worlds: effects besides the believed ones.
    """
    correction = np.where(item.phase.resting[None, :, None], -out.zero[:, None], item.phase.means(out.correction))
    return item.measured[None] + correction / _true_per_read(item, worlds)[:, None, None]


def items_of(t: Touching, armless: Scene, seconds: float, nthread: int) -> list[ContactItem]:
    """Return one item for each episode of a recording that begins at rest in free air, with readings there.

    Args:
        t: the recording.
        armless: its cell without the arm, held by springs.
        seconds: duration of contact to simulate, s, shared equally among all episodes.
        nthread: threads of the simulation.

    Raises:
        UserError: there is no such episode, or the wrench at rest is not the tool's weight.
    """
    rec = t.recording
    calmed = rec if t.torques is None else calm(rec, t.torques)
    felt = touch(replace(calmed, wrench=rec.wrench or WrenchSensor()), t.scene)
    assert felt is not None  # `touching` refused a recording without a wrench
    begun = beginnings(t, felt)
    each = seconds / len(np.unique(episode_numbers(rec)))
    items = [_item(t, path, phase, armless, each, nthread) for path, phase in begun]
    found = [i for i in items if i is not None]
    if not found:
        raise no_free_air(t)
    return found


def _item(t: Touching, path: Path, phase: Phases, armless: Scene, seconds: float, nthread: int) -> ContactItem | None:
    """Return the item of one episode; None if wrench or angles were not read at its start. `seconds` are its own."""
    rec, rows = t.recording, path.rows
    phase = without(thinned(phase, seconds), _read(t, path))
    if not phase.resting.any():
        return None
    time = phase.time
    blank = np.zeros((len(time), len(rec.joints)))
    segment = Segment(
        Control("unknown", rec.rate_hz),
        RULES.contact_block,
        {},
        blank,
        blank,
        blank,
        time,
        rows[phase.rows(path.clock)],
    )
    measured = phase.means(path.wrench[None])[0]
    # placeholders: driving the item, from which the responses follow, needs an item
    unmoved, all_remains = np.zeros((6, *measured.shape)), np.tile(np.eye(6), (len(measured), 1, 1))
    item = ContactItem(
        rec,
        segment,
        t.scene,
        (),
        path=path,
        phase=phase,
        source=t,
        armless=armless,
        path_response=unmoved,
        reading_response=all_remains,
    )
    nominal = driven(item, [World()], nthread)
    sigma = floors(item, nominal, nthread)
    of_path, of_reading = path_response(item, nominal, nthread), reading_response(item, nominal, nthread)
    counts = phase.valid & ~(phase.resting & tared(rec))  # a sensor zeroed at rest reads 0 there in every world
    valid = np.isfinite(measured) & counts[:, None]
    parts = (("force", slice(0, 3)), ("moment", slice(3, 6)))
    channels = tuple(Channel(name, measured[:, p], sigma[:, p], valid[:, p]) for name, p in parts)
    return replace(item, channels=channels, path_response=of_path, reading_response=of_reading)


def _read(t: Touching, path: Path) -> np.ndarray:
    """Return for each step of the path whether the nearest sample has a wrench and all angles, (n,) bool."""
    rows = path.rows[nearest(path.clock, path.time)]
    read = np.concatenate([t.wrench[rows], t.recording.q[rows]], axis=1)
    return np.isfinite(read.sum(axis=1))
