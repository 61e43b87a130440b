"""Make the episodes of a contact recording ready for comparison, and drive hands of worlds along them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vispeg.contact.beginning import beginnings, episode_numbers, no_free_air, tared
from vispeg.contact.drive import Driven, drive
from vispeg.contact.errors.floors import floors
from vispeg.contact.hand import Grasp
from vispeg.contact.inputs import ContactItem, Touching
from vispeg.contact.path import Path
from vispeg.contact.phases import Phases
from vispeg.contact.sensor import hand_world, readings, stands_for
from vispeg.contact.thin import thinned, without
from vispeg.contact.torques import calm
from vispeg.contact.yielding import given_way
from vispeg.core.rules import RULES
from vispeg.identify.channels import Channel
from vispeg.recordings.cell import WrenchSensor
from vispeg.recordings.recording import Control
from vispeg.recordings.regimes import INSIDE, PRESS, REGIMES, SLIDE
from vispeg.robots.scene import Scene
from vispeg.sim.segments.segment import Segment
from vispeg.sim.touch import touch
from vispeg.worlds.world import World

PUSH, LEVER = 0.2, 0.1  # N, m: test error for sensor responses; converts it to torque


def driven(
    item: ContactItem, worlds: Sequence[World], nthread: int = 1, windows: Sequence[slice] | None = None
) -> Driven:
    """Drive hands of worlds with one structure along an item's path, or along some windows of it."""
    hand_worlds = [hand_world(item.source.believed, w) for w in worlds]
    wrench = np.stack([readings(item.path, item.hand, w) for w in hand_worlds])
    windows = item.phase.windows if windows is None else windows
    cell, rest, way = item.source.scene, item.phase.rest, given_way(item, hand_worlds, wrench)
    stands = _stands(item, worlds)
    return drive(item.hand, cell, item.path, hand_worlds, wrench, rest, windows, nthread, way=way, stands=stands)


def _stands(item: ContactItem, worlds: Sequence[World]) -> np.ndarray:
    """Return the true force change per newton read, (nworld,)."""
    hand_worlds = [hand_world(item.source.believed, w) for w in worlds]
    return np.array([stands_for(item.path, item.hand, w) for w in hand_worlds])


def displaced(item: ContactItem, nominal: Driven, nthread: int = 1) -> np.ndarray:
    """Return (6, m, 6) response of the wrench to a kinematic error of the hand's path, one axis each.

    Along the tool's axis a positive error is deeper. `nominal` is the drive of the believed model along the path
    itself.
    """
    off = np.diag(np.repeat([RULES.kinematics_place, RULES.kinematics_turn], 3))
    world = hand_world(item.source.believed, World())
    wrench = np.repeat(readings(item.path, item.hand, world)[None], 6, axis=0)
    phase, scenes = item.phase, (item.hand, item.source.scene)
    stands = _stands(item, [World()] * 6)
    out = drive(*scenes, item.path, [world] * 6, wrench, phase.rest, phase.windows, nthread, off, stands=stands)
    return np.nan_to_num(phase.means(out.correction) - phase.means(nominal.correction)) / stands[0]


def pushed(item: ContactItem, nominal: Driven, nthread: int = 1) -> np.ndarray:
    """Return what remains of the wrench, by row, if one channel, by column, reads one unit too much, (m, 6, 6).

    In free air all of it remains. A contact absorbs forces that push against it, so there a wrong reading hardly
    moves the hand, and a displaced hand has another cause. `nominal` is the drive of the believed model; where it
    touches and the tool did not, nothing is absorbed.
    """
    size, world = np.repeat([PUSH, LEVER * PUSH], 3), hand_world(item.source.believed, World())
    wrench = np.repeat(readings(item.path, item.hand, world)[None], 6, axis=0)
    stands, phase = _stands(item, [World()] * 6), item.phase
    more = np.zeros_like(wrench)
    more[:, phase.rest.stop :] = (np.diag(size) * stands[0])[:, None]
    out = drive(
        item.hand, item.source.scene, item.path, [world] * 6, wrench + more, phase.rest, phase.windows, nthread,
        stands=stands,
    )  # fmt: skip
    change = (phase.means(nominal.correction) - phase.means(out.correction)) / stands[0] / size[:, None, None]
    left = np.moveaxis(change, 0, 2)
    takes_up = phase.of(REGIMES[PRESS]) | phase.of(REGIMES[SLIDE]) | phase.of(REGIMES[INSIDE])
    return np.where((takes_up & np.isfinite(left).all(axis=(1, 2)))[:, None, None], left, np.eye(6))


def predicted(item: ContactItem, out: Driven, worlds: Sequence[World]) -> np.ndarray:
    """(nworld, m, 6): measured wrench, less the zero found in free air, plus the correction, as the sensor reads it.

    While the hand rests at the start, the zero itself is what is compared. Forces are told as readings, whatever a
    world says that these stand for: with readings `y = G w + n` of a wrench w and a path that is off by e, what is left
    is `n + G K e`, and the hold K goes as `1 / G` (`drive`). So noise and path weigh the same in every world, their
    covariance is the same constant for all, and what reads less does not seem to fit them better.
    """
    correction = np.where(item.phase.resting[None, :, None], -out.zero[:, None], item.phase.means(out.correction))
    return item.measured[None] + correction / _stands(item, worlds)[:, None, None]


def items_of(t: Touching, scene: Scene, seconds: float, hold: Grasp, nthread: int) -> list[ContactItem]:
    """One item an episode of a recording, of which `seconds` of contact are driven.

    Raises:
        UserError: no episode begins in free air, or the wrench there is not what the tool weighs.
    """
    rec = t.recording
    calmed = rec if t.torques is None else calm(rec, t.torques)
    felt = touch(replace(calmed, wrench=rec.wrench or WrenchSensor()), t.scene)
    assert felt is not None  # `touching` refused a recording without a wrench
    begun = beginnings(t, felt)
    each = seconds / len(np.unique(episode_numbers(rec)))
    out = [_item(t, path, phase, scene, each, hold, nthread) for path, phase in begun]
    found = [i for i in out if i is not None]
    if not found:
        raise no_free_air(t)
    return found


def _item(
    t: Touching, path: Path, phase: Phases, scene: Scene, seconds: float, hold: Grasp, nthread: int
) -> ContactItem | None:
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
    still, rigid = np.zeros((6, *measured.shape)), np.tile(np.eye(6), (len(measured), 1, 1))
    item = ContactItem(
        rec,
        segment,
        t.scene,
        (),
        path=path,
        phase=phase,
        source=t,
        hand=scene,
        grasp=hold,
        answer=still,
        response=rigid,
    )
    nominal = driven(item, [World()], nthread)
    sigma = floors(item, nominal, nthread)
    answer, response = displaced(item, nominal, nthread), pushed(item, nominal, nthread)
    counts = phase.valid & ~(phase.resting & tared(rec))  # a tared zero is not informative
    valid = np.isfinite(measured) & counts[:, None]
    parts = (("force", slice(0, 3)), ("moment", slice(3, 6)))
    channels = tuple(Channel(name, measured[:, p], sigma[:, p], valid[:, p]) for name, p in parts)
    return replace(item, channels=channels, answer=answer, response=response)


def _read(t: Touching, path: Path) -> np.ndarray:
    """Return steps of the path whose nearest sample has a wrench and all angles, (n,) bool; gaps are bridged."""
    rows = path.rows[np.rint(np.interp(path.time, path.clock, np.arange(len(path.clock)))).astype(int)]
    read = np.concatenate([t.wrench[rows], t.recording.q[rows]], axis=1)
    return np.isfinite(read.sum(axis=1))
