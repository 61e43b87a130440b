"""Plan the motions for `vispeg measure joint`, as tables that a robot can replay, and their order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.errors import UserError
from vispeg.robots.model import RobotModel

FREQUENCIES = (0.1, 0.5, 1.0, 2.0, 4.0, 8.0)  # Hz
TRIANGLES = (0.01, 0.02, 0.05)  # rad/s
SLOWEST, SPEEDS = 0.004, 7  # rad/s, slowest speed of the ladder; number of speeds up to a third of the limit
SIZES = (0.2, 0.5, 1.0)  # sizes of steps, as shares of the greatest
HOLD, REST, STROKE = 1.5, 0.5, 1.5  # s: rest after a step, rest between two motions, time of one way in the ladder


@dataclass(frozen=True)
class Part:
    """One motion of the plan.

    Attributes:
        name: of the motion and its file.
        shows: what it consists of or shows, in one line.
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

    The greatest steps come first and again last, which shows a drift; the other motions are in random order.

    Args:
        robot: the arm, with the joint's range and greatest speed.
        joint: name of the joint that moves.
        middle: the angle about which it moves, rad.
        size: the greatest step, rad; the ladder may reach farther, within the joint's range.
        rate_hz: samples per second.
        rng: shuffles the order.

    Raises:
        UserError: no such joint, or no room for that size about its middle.
    """
    if joint not in robot.joints:
        raise UserError("no such joint", got=joint, choices=robot.joints)
    j = robot.joints.index(joint)
    low, high = robot.range[j]
    limit = float(min(robot.velocity_limit[j], 10.0))
    fast = limit / 3.0
    reach = max(size, STROKE * fast / 2.0)
    room = float(min(middle - low, high - middle))
    if not 0 < size <= room:
        raise UserError("no room for that step", key="--size", expected=f"above 0, {room:.3g} rad at most", got=size)
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
    levels = np.array([0.0, size, 0.0, -size, 0.0, size, 0.0, -size, 0.0, size, 0.0, -size, 0.0])
    held = round(HOLD * rate)
    offset = np.repeat(levels, held)
    return Part(
        f"steps-{1e3 * size:.0f}mrad", f"steps of {size:.3g} rad, both ways", np.arange(len(offset)) / rate, offset
    )


def _sines(name: str, size: float, limit: float, rate: float, rng: np.random.Generator) -> Part:
    order = [FREQUENCIES[k] for k in rng.permutation(len(FREQUENCIES))]
    chunks = [np.zeros(round(REST * rate))]
    for hz in [*order, order[0]]:
        amplitude = min(size, 0.4 * limit / (2.0 * np.pi * hz))
        count = max(3, round(3.0 * hz)) + 1  # one to settle
        count = min(range(count, count + 4), key=lambda n: round(abs(n / hz * rate - round(n / hz * rate)), 6))
        # starts and ends at rest in the middle, where a sine's speed jumps; the first period lets the transient decay
        t = np.arange(round(count / hz * rate)) / rate
        chunks += [amplitude * np.sin(2.0 * np.pi * hz * t), np.zeros(round(REST * rate))]
    offset = np.concatenate(chunks)
    shows = f"sines of {FREQUENCIES[0]:g} to {FREQUENCIES[-1]:g} Hz, {size:.3g} rad and less"
    return Part(name, shows, np.arange(len(offset)) / rate, offset)


def _triangle(size: float, rate: float) -> Part:
    knots, levels = [0.0], [0.0]
    for speed in TRIANGLES:
        way = 2.0 * size
        for to in (size, -size, size, -size, 0.0):
            knots.append(
                knots[-1] + (way if abs(to) == size and len(levels) > 1 and levels[-1] != 0.0 else size) / speed
            )
            levels.append(to)
    t = np.arange(int(knots[-1] * rate)) / rate
    shows = f"triangles of {size:.3g} rad at {', '.join(f'{s:g}' for s in TRIANGLES)} rad/s: the loop at reversal"
    return Part("triangle", shows, t, np.interp(t, knots, levels))


def _ladder(fast: float, reach: float, rate: float, rng: np.random.Generator) -> Part:
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
    """Return a motion as CSV text: time (s), q_cmd.* (rad), and dq_cmd.* of 0, so that only the angles command.

    Args:
        part: the motion.
        joints: names of all joints.
        posture: (nj,) rad, commands of the joints at rest; that of `joint` is the middle of the motion.
        joint: name of the joint that moves.
    """
    j = list(joints).index(joint)
    head = ",".join(["time", *(f"q_cmd.{n}" for n in joints), *(f"dq_cmd.{n}" for n in joints)])
    before = ",".join(f"{x:.9g}" for x in posture[:j])
    after = ",".join([*(f"{x:.9g}" for x in posture[j + 1 :]), *("0" for _ in joints)])
    left, right = before + "," if j else "", "," + after
    rows = [f"{t:.6f},{left}{posture[j] + x:.9g}{right}" for t, x in zip(part.time, part.offset, strict=True)]
    return "\n".join([head, *rows]) + "\n"
