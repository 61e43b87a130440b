"""Plan the motions for `vispeg measure joint` and their order, and write each as a table that a robot can replay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.errors import UserError
from vispeg.robots.model import RobotModel

FREQUENCIES = (0.1, 0.5, 1.0, 2.0, 4.0, 8.0)  # Hz, of the sines
TRIANGLES = (0.01, 0.02, 0.05)  # rad/s, speeds of the triangles
SLOWEST, SPEEDS = 0.004, 7  # rad/s, slowest speed of the ladder; number of its speeds, up to a third of the limit
SIZES = (0.2, 0.5, 1.0)  # sizes of steps, as shares of the greatest
HOLD = 3.0  # s, rest after each step: one that finds the joint still swinging shows another damping
REST = 0.5  # s: rest between two sines, and between two speeds of the ladder
STROKE = 1.5  # s, time of each way in the ladder, unless the way is then under 0.04 rad or over twice the reach


@dataclass(frozen=True)
class Part:
    """One motion of the plan.

    Attributes:
        name: of the motion and its file.
        shows: what it consists of and what it is for, in one line.
        time: (n,) s.
        offset: (n,) rad, the joint's command relative to its middle angle.
    """

    name: str
    shows: str
    time: np.ndarray
    offset: np.ndarray


def plan(
    robot: RobotModel, joint: str, middle: float, size: float, rate_hz: float, rng: np.random.Generator
) -> list[Part]:
    """Return the motions in the order in which to run them.

    The greatest steps come first and once more at the end, which shows a drift; the others are in random order.

    Args:
        robot: the arm, with the joint's range and greatest speed.
        joint: name of the joint that moves.
        middle: the angle about which it moves, rad.
        size: the greatest step, rad; the ladder may reach farther, at most 0.9 of the way to the range's nearer end.
        rate_hz: samples per second.
        rng: shuffles the order.

    Raises:
        UserError: no such joint, `middle` is not inside its range, or steps of `size` leave the range.
    """
    if joint not in robot.joints:
        raise UserError("no such joint", got=joint, choices=robot.joints)
    j = robot.joints.index(joint)
    low, high = robot.range[j]
    limit = float(min(robot.velocity_limit[j], 10.0))
    fast = limit / 3.0
    reach = max(size, STROKE * fast / 2.0)
    room = float(min(middle - low, high - middle))
    if not room > 0:
        expected = f"between {low:.3g} and {high:.3g} rad"
        raise UserError(f"{joint} has no room to move both ways", key="--posture", expected=expected, got=middle)
    if not 0 < size <= room:
        expected = f"above 0, and at most {room:.3g} rad, the way to the nearer end of the joint's range"
        raise UserError("not a possible step", key="--size", expected=expected, got=size)
    reach = min(reach, 0.9 * room)
    parts = [_steps(share * size, rate_hz) for share in SIZES]
    parts += [
        _sines(f"sines-{word}", share * size, limit, rate_hz, rng) for word, share in (("large", 0.5), ("small", 0.2))
    ]
    parts += [_triangle(min(0.05, size), rate_hz), _ladder(fast, reach, rate_hz, rng)]
    first = parts.pop(len(SIZES) - 1)
    order = [parts[k] for k in rng.permutation(len(parts))]
    return [
        first,
        *order,
        Part(f"{first.name}-again", f"drift, by comparison with {first.name}", first.time, first.offset),
    ]


def _steps(size: float, rate: float) -> Part:
    """Return steps from 0 to +-`size` rad and back at `rate` Hz, each held for HOLD."""
    levels = np.array([0.0, size, 0.0, -size, 0.0, size, 0.0, -size, 0.0])
    held = round(HOLD * rate)
    offset = np.repeat(levels, held)
    return Part(
        f"steps-{1e3 * size:.0f}mrad", f"steps of {size:.3g} rad, both ways", np.arange(len(offset)) / rate, offset
    )


def _sines(name: str, size: float, limit: float, rate: float, rng: np.random.Generator) -> Part:
    """Return sines of all frequencies in random order, the first one again at the end, at `rate` Hz.

    Their amplitude is `size` rad, or less where the speed would exceed 0.4 of `limit` rad/s.
    """
    order = [FREQUENCIES[k] for k in rng.permutation(len(FREQUENCIES))]
    chunks = [np.zeros(round(REST * rate))]
    for hz in [*order, order[0]]:
        amplitude = min(size, 0.4 * limit / (2.0 * np.pi * hz))
        count = max(3, round(3.0 * hz)) + 1  # periods: 3 s, at least three, after one in which the transient decays
        # of this number and the next three, the one whose duration is nearest to whole samples
        count = min(range(count, count + 4), key=lambda n: round(abs(n / hz * rate - round(n / hz * rate)), 6))
        # each sine starts and ends at 0, where its speed jumps from and to rest
        t = np.arange(round(count / hz * rate)) / rate
        chunks += [amplitude * np.sin(2.0 * np.pi * hz * t), np.zeros(round(REST * rate))]
    offset = np.concatenate(chunks)
    shows = f"sines of {FREQUENCIES[0]:g} to {FREQUENCIES[-1]:g} Hz, {size:.3g} rad and less"
    return Part(name, shows, np.arange(len(offset)) / rate, offset)


def _triangle(size: float, rate: float) -> Part:
    """Return triangles of +-`size` rad, two periods at each speed of TRIANGLES, at `rate` Hz."""
    knots, levels = [0.0], [0.0]
    for speed in TRIANGLES:
        for to in (size, -size, size, -size, 0.0):
            knots.append(knots[-1] + abs(to - levels[-1]) / speed)
            levels.append(to)
    t = np.arange(int(knots[-1] * rate)) / rate
    shows = f"triangles of {size:.3g} rad at {', '.join(f'{s:g}' for s in TRIANGLES)} rad/s: hysteresis at reversals"
    return Part("triangle", shows, t, np.interp(t, knots, levels))


def _ladder(fast: float, reach: float, rate: float, rng: np.random.Generator) -> Part:
    """Return ways out and back from -`reach` rad at constant speeds, SLOWEST to `fast` rad/s, at `rate` Hz.

    The speeds are in random order, the slowest once more at the end.
    """
    speeds = np.geomspace(SLOWEST, fast, SPEEDS)
    order = [*rng.permutation(speeds), speeds[0]]
    knots, levels = [0.0, REST], [-reach, -reach]
    for speed in order:
        way = float(np.clip(speed * STROKE, 10.0 * SLOWEST, 2.0 * reach))
        knots += [knots[-1] + way / speed, knots[-1] + 2.0 * way / speed, knots[-1] + 2.0 * way / speed + REST]
        levels += [-reach + way, -reach, -reach]
    t = np.arange(int(knots[-1] * rate)) / rate
    first = np.linspace(0.0, 1.0, round(2.0 * rate), endpoint=False)
    approach = -reach * first**2 * (3.0 - 2.0 * first)
    offset = np.concatenate([approach, np.interp(t, knots, levels)])
    shows = f"a ladder of {SPEEDS} speeds from {SLOWEST:g} to {fast:.2g} rad/s, both ways, the slowest again at the end"
    return Part("ladder", shows, np.arange(len(offset)) / rate, offset)


def table(part: Part, joints: Sequence[str], posture: np.ndarray, joint: str) -> str:
    """Return a motion as CSV text: time (s), q_cmd.* (rad), and dq_cmd.* (rad/s), all 0: only angles are commanded.

    Args:
        part: the motion.
        joints: names of all joints.
        posture: (nj,) rad, commands of the joints at rest; that of `joint` is the middle of the motion.
        joint: name of the joint that moves.
    """
    j = list(joints).index(joint)
    head = ",".join(["time", *(f"q_cmd.{n}" for n in joints), *(f"dq_cmd.{n}" for n in joints)])
    before = "".join(f"{x:.9g}," for x in posture[:j])
    after = "".join(f",{x}" for x in (*(f"{x:.9g}" for x in posture[j + 1 :]), *("0" for _ in joints)))
    rows = [f"{t:.6f},{before}{posture[j] + x:.9g}{after}" for t, x in zip(part.time, part.offset, strict=True)]
    return "\n".join([head, *rows]) + "\n"
