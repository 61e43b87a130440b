"""Extract readings from recordings with a wrench: poses at rest, strokes of a slide, ramps of a press.

A slide or a press begins with a second in free air, whose mean wrench is the sensor's bias. Episodes of one recording
are further rests, slides or presses, each with a bias and a beginning of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.core.errors import UserError
from vispeg.measure.readings import Readings
from vispeg.recordings.cell import WrenchSensor, canonical, reaction
from vispeg.recordings.checks.quality import runs
from vispeg.recordings.differentiate import bridged, episodes, usual_rate
from vispeg.recordings.load import load
from vispeg.recordings.recording import Recording
from vispeg.robots.model import load as load_robot
from vispeg.robots.model import tilted
from vispeg.sim.compiled import flange_pose
from vispeg.sim.recorded import with_robot
from vispeg.sim.touch import tool_of
from vispeg.sim.units import check_units

DOWN = np.array([0.0, 0.0, -1.0])

REST, STILL = 0.5, 2e-3  # at rest: all joints within STILL rad for REST s
FREE, TOUCH = 1.0, 1.0  # s of free air at the start, N above which there is contact
SPEED, STROKE = 2e-3, 0.3  # a stroke is faster than SPEED m/s across the flange's axis for STROKE s
SMOOTH = 0.05  # s, averaging window of the speed


def at_rest(paths: Sequence[Path]) -> Readings:
    """Return the mean wrench (N, N m) and the direction of gravity, both in the flange frame, of every stretch at rest.

    The wrench is that of the tool on the flange.

    Raises:
        UserError: a recording that cannot be read, has no `ft` or one without the tool's weight, or never rests.
    """
    wrench, down = [], []
    for path in paths:
        rec, parts = _opened(path)
        if rec.wrench is not None and rec.wrench.tared == "weight":
            what, expected = "the robot has subtracted the tool's weight", "readings that contain it: false or true"
            raise UserError(what, file=path / "recording.yaml", key="wrench.tared", expected=expected, got="weight")
        length, before = max(2, round(REST * _rate(rec))), len(wrench)
        for part in parts:
            for rows in _rests(bridged(part.time, part.q), length):
                wrench.append(reaction(part.wrench[rows].mean(axis=0)))
                down.append(part.turn[(rows.start + rows.stop) // 2].inv().apply(tilted(DOWN, *rec.base_tilt)))
        if len(wrench) == before:
            raise UserError(f"never rests for {REST:g} s", file=path, expected="an attitude that is held")
    names = ("fx", "fy", "fz", "tx", "ty", "tz", "gx", "gy", "gz")
    return Readings(paths[0], dict(zip(names, np.hstack([wrench, down]).T, strict=True)))


def declared_tool(paths: Sequence[Path]) -> tuple[float, np.ndarray]:
    """Return mass, kg, and centre of mass (3,), m, flange frame, of the tool that the recordings declare.

    Both are 0 without a tool.

    Raises:
        UserError: a recording that cannot be read, an unknown tool, or recordings of different tools.
    """
    declared = [(rec.robot, rec.tool) for rec in (load(path, lambda header: ()) for path in paths)]
    tools = [(0.0, np.zeros(3)) if tool is None else tool_of(load_robot(robot, tool))[:2] for robot, tool in declared]
    first = np.hstack(tools[0])
    for path, tool in zip(paths, tools, strict=True):
        if not np.allclose(np.hstack(tool), first):
            expected, got = f"{first[0]:g} kg, as the first one's", f"{tool[0]:g} kg"
            raise UserError("a recording of another tool", file=path, key="tool", expected=expected, got=got)
    return tools[0]


def slides(paths: Sequence[Path]) -> Readings:
    """Return the normal force (along the flange's z) and the tangential force of every stroke, N.

    With several recordings, the column `place` holds the recording's number.

    Raises:
        UserError: a recording that cannot be read, has no `ft`, or in which nothing slides.
    """
    rows: list[tuple[float, float, float]] = []
    for at, path in enumerate(paths):
        rec, parts = _opened(path)
        width, before = max(1, round(SMOOTH * _rate(rec))), len(rows)
        for part in parts:
            force = _unbiased(part, path)
            moved = np.gradient(part.position, part.time, axis=0)
            across = part.turn.inv().apply(moved)[:, :2]  # velocity along z is pressing, not sliding
            smooth = np.stack([np.convolve(v, np.ones(width) / width, "same") for v in across.T], axis=1)
            sliding = (np.linalg.norm(smooth, axis=1) > SPEED) & (np.abs(force[:, 2]) > TOUCH)
            for s in (slice(*run) for run in runs(sliding)):
                if part.time[s][-1] - part.time[s][0] >= STROKE:
                    normal, tangential = np.abs(force[s, 2]), np.hypot(force[s, 0], force[s, 1])
                    load = float(np.median(normal))  # a median, as the ratio dips at reversals
                    rows.append((load, load * float(np.median(tangential / normal)), float(at)))
        if len(rows) == before:
            what = f"nothing slides: no {STROKE:g} s above {SPEED:g} m/s and {TOUCH:g} N"
            raise UserError(what, file=path)
    table = np.array(rows)
    columns = {"normal": table[:, 0], "tangential": table[:, 1]}
    if len(paths) > 1:
        columns["place"] = table[:, 2]
    return Readings(paths[0], columns, {"normal": 0.0, "tangential": 0.0})


def presses(stop: Sequence[Path], fixture: Sequence[Path]) -> Readings:
    """Return force (N) and depth (m) along the flange's z of every press; loading and unloading are separate ramps.

    Args:
        stop: recordings of presses on a rigid stop, one per arm pose.
        fixture: recordings of presses on the fixture, in the same order of arm poses.

    Raises:
        UserError: different numbers of recordings; one that cannot be read, has no `ft` or never touches.
    """
    if len(stop) != len(fixture) or not stop:
        expected = "as many of --stop as of --fixture, in the same order of arm poses"
        raise UserError("presses without their counterpart", expected=expected, got=f"{len(stop)} and {len(fixture)}")
    tables = []
    for on, paths in enumerate((stop, fixture)):
        for pose, path in enumerate(paths):
            touched = False
            for press, part in enumerate(_opened(path)[1]):
                force = np.abs(_unbiased(part, path)[:, 2])
                depth = np.abs(part.turn[0].inv().apply(part.position - part.position[0])[:, 2])
                touching = np.flatnonzero(force > TOUCH)
                touched |= len(touching) > 0
                top = int(np.argmax(force))
                for way, rows in enumerate((touching[touching <= top], touching[touching > top])):
                    if len(rows) > 2:
                        ramp = np.tile([on, pose, 2 * press + way], (len(rows), 1))
                        tables.append(np.column_stack([force[rows], depth[rows], ramp]))
            if not touched:
                raise UserError(f"never touches with more than {TOUCH:g} N", file=path)
    table = np.concatenate(tables)
    names = ("force", "depth", "on", "pose", "ramp")
    return Readings(stop[0], dict(zip(names, table.T, strict=True)), {"force": 0.0, "depth": 0.0})


@dataclass(frozen=True)
class _Part:
    """One episode of a recording; rows without a pose or without a wrench are left out.

    Attributes:
        number: the episode; None for a recording without episodes.
        time: (n,) s.
        q: (n, nj) rad, NaN where missing.
        wrench: (n, 6) N, N m of the flange on the tool, about the flange's origin, flange axes.
        position, turn: the flange's positions (n, 3) m and n rotations in the base.
    """

    number: int | None
    time: np.ndarray
    q: np.ndarray
    wrench: np.ndarray
    position: np.ndarray
    turn: Rotation


def _opened(path: Path) -> tuple[Recording, list[_Part]]:
    """Load a recording with a wrench, and split it into its episodes of two samples or more.

    The pose is measured; if `ee` was not recorded, it is from the robot's kinematics and angles without gaps.
    """
    rec = load(path)
    check_units(rec)
    if rec.ft is None:
        raise UserError("has no wrench", file=path, expected="columns ft.fx ... ft.tz")
    ft, pose = rec.ft, rec.ee
    if pose is None or not np.isfinite(pose).all(axis=1).any():
        rec, robot = with_robot(rec)
        pose = flange_pose(robot, bridged(rec.time, rec.q, rec.episode))
    known = np.isfinite(ft).all(axis=1) & np.isfinite(pose).all(axis=1)
    if not known.any():
        raise UserError("no sample has both a wrench and a pose", file=path)
    rec, ft, pose = rec.some(known), ft[known], pose[known]
    turn = Rotation.from_quat(pose[:, 3:], scalar_first=True)
    wrench = canonical(ft, rec.wrench or WrenchSensor(), turn.as_matrix())
    parts = [
        _Part(
            None if rec.episode is None else int(rec.episode[rows[0]]),
            rec.time[rows],
            rec.q[rows],
            wrench[rows],
            pose[rows, :3],
            turn[rows],
        )
        for rows in episodes(rec.time, rec.episode)
        if len(rows) > 1
    ]
    return rec, parts


def _rate(rec: Recording) -> float:
    """Return the usual number of samples per second."""
    return usual_rate(rec.time, episodes(rec.time, rec.episode))


def _unbiased(part: _Part, path: Path) -> np.ndarray:
    """Return the force (n, 3) N minus its mean in the first second, which must be in free air."""
    free = part.time - part.time[0] < FREE
    force = part.wrench[:, :3]
    if np.std(force[free], axis=0).max() > TOUCH:
        key = None if part.number is None else f"episode {part.number}"
        raise UserError(f"does not begin with {FREE:g} s in free air", file=path, key=key)
    return force - force[free].mean(axis=0)


def _rests(q: np.ndarray, length: int) -> list[slice]:
    """Return disjoint stretches of at least `length` rows in which every joint stays within `STILL` rad."""
    out, start = [], 0
    while start + length <= len(q):
        end = start + length
        if not np.ptp(q[start:end], axis=0).max() <= STILL:
            start += max(1, length // 10)
            continue
        while end < len(q) and np.abs(q[end] - q[start]).max() <= STILL:
            end += 1
        out.append(slice(start, end))
        start = end
    return out
