"""Motions for calibrating a camera: tilt, roll, approach, and sideways past the fixture.

The hand circles around the middle of the goal, so that a camera on it keeps the fixture in view and one beside the
cell sees the hand. Every part goes both ways at changing speed. A delay would be confounded with a constant offset if
the motion had one direction and speed, a focal length with distance without tilt, a principal point with a rotation
without roll, and the scale of depth with its bias at a single distance (`vispeg/vision` has the sensitivities).
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from vispeg.core.errors import UserError
from vispeg.identify.excitation import Motion, smoothstep
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import flange_pose, nominal_of
from vispeg.sim.home import home_of
from vispeg.sim.reach import reach

FREEDOMS = ("tip", "lean", "roll", "rise", "along", "across")
KNOTS = 40.0  # per second, rate at which postures are solved
HEIGHT = 0.06  # m, height of the tip over the goal in the middle of the motion
EASE = 1.0  # s, fade-in and fade-out of the motion
GROWTH = 8  # steps in which the amplitude grows while postures are solved
EXACT = 1e-4  # largest residual of inverse kinematics, m and rad together
FAST = 0.8  # usable share of the joints' speed limits
DOWN = Rotation.from_quat([1.0, 0.0, 0.0, 0.0])  # flange z straight down


@dataclass(frozen=True)
class Part:
    """A sine of one of the hand's freedoms: amplitude `size` (rad or m), `cycles` periods in the motion.

    `phase` at the start is a share of a period. Freedoms: `tip` and `lean` turn the hand about the goal (about the
    base's y and x), `roll` about its own axis, `rise` lifts it (0 to 2 `size`), `along` and `across` move it sideways.
    """

    freedom: str
    size: float
    cycles: int
    phase: float = 0.0


TILT = (Part("tip", 0.3, 2), Part("lean", 0.35, 3, 0.13))
ROLL = (Part("roll", 0.7, 2, 0.4),)
APPROACH = (Part("rise", 0.09, 2, 0.0),)
SIDEWAYS = (Part("along", 0.04, 4), Part("across", 0.05, 5, 0.2))
FAST_SIDEWAYS = (Part("along", 0.06, 9), Part("across", 0.06, 8, 0.2))
LOOKS: dict[str, tuple[Part, ...]] = {
    "look": (*TILT, *ROLL, *APPROACH, *SIDEWAYS),
    "look-tilt": TILT,
    "look-roll": ROLL,
    "look-approach": APPROACH,
    "look-sideways": SIDEWAYS,
    "look-fast": (*FAST_SIDEWAYS, Part("rise", 0.04, 3), Part("roll", 0.5, 2, 0.4)),
}
ABOUT = {
    "look": "tilt, roll, approach and sideways at once, about the goal: what a camera is calibrated from",
    "look-tilt": "the hand tilts about the goal",
    "look-roll": "the hand turns about its own axis",
    "look-approach": "the hand comes near and goes away",
    "look-sideways": "the hand moves sideways past the fixture and back",
    "look-fast": "the same more than twice as fast, turned both ways: shows a late camera and a rolling shutter",
}


def look_motion(name: str, scene: Scene, rate_hz: float, duration: float) -> Motion:
    """Return a commanded motion of the arm in a cell, at rest at both ends.

    Args:
        name: one of `LOOKS`.
        scene: the nominal cell.
        rate_hz, duration: samples a second, seconds.

    Raises:
        UserError: no such motion; a bench, which has no goal to look about; too short for the joints' speeds; a pose
            out of reach, or one that touches something.
    """
    if name not in LOOKS:
        raise UserError("unknown motion", key="--motion", got=name, choices=LOOKS)
    if not scene.goal:
        expected = "a motion of the joints by name, or a table with q_cmd columns"
        raise UserError("there is no goal to look about", key="--motion", expected=expected, got=name)
    if not 4 * EASE <= duration <= 120 or not 20 <= rate_hz <= 4000:
        expected = f"{4 * EASE:g} to 120 s at 20 to 4000 Hz"
        raise UserError("no such motion", key="--duration", expected=expected, got=f"{duration:g} s at {rate_hz:g} Hz")
    motion = _made(name, scene, rate_hz, duration)
    share, joint = _speed(motion, scene)
    if share > 1:
        least = f"{_shortest(name, scene, rate_hz):.1f} s or more"
        raise UserError(f"{name} is too fast for {joint}", key="--duration", expected=least, got=f"{duration:g} s")
    _touches_nothing(motion, scene)
    return motion


def _made(name: str, scene: Scene, rate_hz: float, duration: float) -> Motion:
    """Return the motion without a speed limit. Raises UserError for a pose out of reach."""
    knots = np.linspace(0.0, duration, round(duration * KNOTS) + 1)
    nominal = nominal_of(scene.nominal, len(knots))
    x, y, z = scene.target
    home = home_of(scene.nominal, (x, y, z + HEIGHT + scene.tip), (0.0, 1.0, 0.0, 0.0))
    down = _down(scene, home)
    q = np.tile(home, (len(knots), 1))
    error = np.zeros(len(knots))
    for grown in np.linspace(0.0, 1.0, GROWTH):  # grow from rest, so that inverse kinematics stays on one branch
        turns, places = _poses(name, scene, knots, float(grown), down)
        q, error = reach(nominal, places, turns.as_quat()[:, [3, 0, 1, 2]], q)
    low, high = scene.range.T
    bad = (error > EXACT) | (q < low).any(axis=1) | (q > high).any(axis=1)
    if bad.any():
        message = f"{name}: the arm cannot look from everywhere, first at {knots[bad.argmax()]:.1f} s"
        raise UserError(message, expected="a fixture nearer to the middle of its reach", got=list(scene.target))
    spline = CubicSpline(knots, q, bc_type="clamped")
    time = np.arange(round(duration * rate_hz)) / rate_hz
    return Motion(name, time, spline(time), spline(time, 1))


def _down(scene: Scene, home: np.ndarray) -> Rotation:
    """Return the flange pointing straight down, turned as at home, so that the last joint is in mid-range."""
    at_home = Rotation.from_quat(flange_pose(scene.nominal, home)[[4, 5, 6, 3]])
    axis = (at_home * DOWN.inv()).as_matrix()[:, 0]
    return Rotation.from_euler("z", float(np.arctan2(axis[1], axis[0]))) * DOWN


def _poses(name: str, scene: Scene, time: np.ndarray, grown: float, down: Rotation) -> tuple[Rotation, np.ndarray]:
    """Return orientation and position (n, 3) m of the flange in the base, for a motion at `grown` times its size."""
    total = float(time[-1])
    at = {freedom: np.zeros(len(time)) for freedom in FREEDOMS}
    eased = np.clip(np.minimum(time, total - time) / EASE, 0.0, 1.0)
    weight = smoothstep(eased)[1]
    for part in LOOKS[name]:
        angle = 2 * np.pi * (part.cycles * np.clip(time / total, 0.0, 1.0) + part.phase)
        wave = 1 - np.cos(angle) if part.freedom == "rise" else np.sin(angle)
        at[part.freedom] = at[part.freedom] + grown * part.size * weight * wave
    about = Rotation.from_euler("xy", np.stack([at["lean"], at["tip"]], 1))
    goal = np.array(scene.target)
    above = np.stack([at["along"], at["across"], HEIGHT + at["rise"] + scene.tip], 1)
    return about * down * Rotation.from_euler("z", at["roll"][:, None]), goal + about.apply(above)


def _speed(motion: Motion, scene: Scene) -> tuple[float, str]:
    """Return the largest ratio of a joint's speed to its usable limit, and the joint's name."""
    share = np.abs(motion.dq_cmd).max(axis=0) / (FAST * np.asarray(scene.velocity_limit))
    return float(share.max()), scene.joints[int(share.argmax())]


def _shortest(name: str, scene: Scene, rate_hz: float) -> float:
    """Return the shortest duration of the motion in s, rounded to tenths, whatever was requested.

    Speed is not simply proportional to 1 / duration, because `EASE` at both ends is fixed.
    """
    duration = share = 4 * EASE
    while share > 1:
        share, _ = _speed(_made(name, scene, rate_hz, duration), scene)
        duration = float(np.ceil(10 * duration * share - 1e-6)) / 10 if share > 1 else duration
    return duration


def _touches_nothing(motion: Motion, scene: Scene) -> None:
    """Raise UserError if the motion touches something in the cell."""
    model = scene.compile()
    data, places = mujoco.MjData(model), [model.joint(j).qposadr[0] for j in scene.joints]
    stride = max(1, round(0.05 / (motion.time[1] - motion.time[0])))  # postures 0.05 s apart
    for row in range(0, len(motion.time), stride):
        data.qpos[places] = motion.q_cmd[row]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        if data.ncon:
            pair = [model.geom(g).name or model.body(model.geom_bodyid[g]).name for g in data.contact[0].geom]
            message = f"{motion.name}: {pair[0]} touches {pair[1]} at {motion.time[row]:.1f} s"
            raise UserError(message, expected="a cell with room about the goal")
