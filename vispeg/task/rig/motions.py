"""Motions in a cell that reveal errors of its contact model. Each begins with about a second in free air.

What each motion identifies:
- free air: the tool's mass and centre of mass, and the zero of the force sensor;
- presses: stiffness, compliance and heights; with the elbow turned, also which compliance is the arm's;
- slides: friction;
- insertions: the gap and the goal's place;
- hard presses: slip in the grip;
- taps: damping;
- a touched datum: which errors of height come from the grip, from the goal and from the arm.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.validate import check_length
from vispeg.robots.scene import Scene
from vispeg.task.config import TaskConfig
from vispeg.task.rig.commanded import CellMotion
from vispeg.task.rig.pace import paced, with_room
from vispeg.task.rig.path import FORCE, Frame, Path, commands, quarter
from vispeg.task.rig.posture import elbow_turned, posture

OVER = 0.03  # m, height of the tip over the fixture in free air
NEAR = 0.0015  # m, height over a surface below which the tip moves slowly
LOOK, LOOKS = 0.06, 14  # m, mean height of the tip over the goal while cameras look at it; number of views
AIR = 1.1  # s in free air with which every motion begins


@dataclass(frozen=True)
class Place:
    """The inputs of a motion: the believed cell, its dimensions, and random variations.

    Attributes:
        scene: the believed cell.
        rng: varies places, forces and speeds a little, so that different seeds give different recordings.
    """

    scene: Scene
    rng: np.random.Generator

    @property
    def gap(self) -> float:
        """Width of the goal minus that of the held part, m."""
        return self.scene.config.gap

    @property
    def depth(self) -> float:
        """Depth of the goal, m."""
        return self.scene.config.depth

    @property
    def aside(self) -> float:
        """Distance from the goal's axis, m, at which the held part stands on the middle of the fixture's rim."""
        config = self.scene.config
        return 0.5 * (config.apothem + config.chamfer + config.block)

    def vary(self, value: float, share: float = 0.12) -> float:
        """Return the value times a random factor within 1 +- share."""
        return float(value * (1 + share * self.rng.uniform(-1.0, 1.0)))

    def begin(self, over: float = OVER) -> Path:
        """Begin a path in free air, `over` m above the goal, with a nod of the tool that shows the sensor's zero."""
        start = Frame((0.0, 0.0, over))
        nod = self.vary(0.05)
        return Path(start).to(0.5).to(0.3, turn=(nod, 0.0, 0.0)).to(AIR - 0.8, turn=(0.0, 0.0, 0.0))


def free(place: Place) -> Path:
    """Tilt by 30 to 34 deg about both axes, and shake: shows the tool's mass, centre of mass, and the sensor's zero."""
    path, tilt = place.begin(0.12), place.vary(0.56, 0.05)
    path.to(1.2, yaw=quarter(place.scene))
    for turn in ((tilt, 0, 0), (-tilt, 0, 0), (0, tilt, 0), (0, -tilt, 0), (0, 0, 0)):
        path.to(0.9, turn=turn).to(0.25)
    x = place.vary(0.03)
    for tip in ((x, 0, 0.12), (-x, 0, 0.12), (0, x, 0.15), (0, -x, 0.09), (0, 0, 0.12)):
        path.to(0.35, tip=tip)
    return path.to(0.3)


def press(place: Place, count: int = 4) -> Path:
    """Press straight down with 5 to 25 N at several places around the goal."""
    path, first = place.begin(), place.rng.uniform(0, np.pi / 2)
    for k in range(count):
        angle = first + 2 * np.pi * k / count
        x, y = place.aside * np.cos(angle), place.aside * np.sin(angle)
        _down(path, x, y, 5.0)
        path.to(0.8, force=(0, 0, -place.vary(25.0, 0.05))).to(0.2).to(0.6, force=(0, 0, -5.0)).to(0.15)
        _up(path)
    return path.to(0.2)


def press_elbow(place: Place) -> Path:
    """Press as `press` does, but with the elbow turned.

    This separates the arm's compliance from that of the fixture, which does not depend on the arm's posture. `motion`
    turns the elbow, as `TURNED` says.
    """
    return press(place)


def slide(place: Place) -> Path:
    """Slide along two perpendicular lines on two sides of the goal, each there and back, pressing with two forces.

    The tool leans sideways, so that its flat end touches the fixture at one place of its rim.
    """
    path, lean = place.begin(), place.vary(0.07)
    for force, along in product((place.vary(5.0), place.vary(10.0)), (0, 1)):
        _slid(path, place, force, along, lean)
    return path.to(0.2)


def _slid(path: Path, place: Place, force: float, along: int, lean: float) -> None:
    """Slide along one line there and back, and lift off.

    Args:
        path: extended in place.
        place: inputs of the motion.
        force: N, with which the tip presses down.
        along: axis of the line, 0 for x, 1 for y.
        lean: rad, tilt of the tool.
    """
    reach = 0.85 * place.aside
    a, b = [place.aside, place.aside], [place.aside, place.aside]
    a[along], b[along] = -reach, reach
    path.to(0.3, turn=(lean * (along == 0), lean * (along == 1), 0.0))
    _down(path, a[0], a[1], force)
    seconds, drag = 2 * reach / place.vary(0.03), place.scene.config.friction * force
    for end, sign in ((b, 1.0), (a, -1.0)):
        push = (sign * drag * (along == 0), sign * drag * (along == 1), -force)
        path.to(0.15, force=push).to(seconds, "even", tip=(end[0], end[1], 0.0)).to(0.15)
    path.to(0.15, force=(0, 0, -force))
    _up(path)


def insert(place: Place, yaw: float = 0.0) -> Path:
    """Enter the goal along its chamfer and press against the wall all around, at two depths and with two forces."""
    path = place.begin()
    if yaw:
        path.to(1.2, yaw=yaw)
    return _inserted(path, place)


def _inserted(path: Path, place: Place) -> Path:
    """Append the insertion to a path that has ended in free air over the goal."""
    angle = place.rng.uniform(0, 2 * np.pi)
    x, y = 0.6 * place.gap * np.cos(angle), 0.6 * place.gap * np.sin(angle)
    path.to(0.6, tip=(x, y, 0.004)).to(0.8, tip=(x, y, -0.004)).to(0.3, tip=(0, 0, -0.004))
    for share, force in ((0.45, place.vary(5.0)), (0.85, place.vary(13.0))):
        path.to(0.7, tip=(0, 0, -share * place.depth))
        for k in range(7):  # once around, and back to the first direction
            at = angle + 2 * np.pi * k / 6
            path.to(0.35, force=(force * np.cos(at), force * np.sin(at), 0))
        path.to(0.3, force=(0, 0, 0))
    path.to(1.0, tip=(0, 0, -place.depth), force=(0, 0, -8.0)).to(0.3)
    return path.to(0.8, tip=(0, 0, 0.01), force=(0, 0, 0)).to(0.2)


def insert_turned(place: Place) -> Path:
    """Insert with the flange turned by 90 deg: separates the part's pose in the grip from the goal's place."""
    return insert(place, quarter(place.scene))


def rock(place: Place) -> Path:
    """Tilt the held part in the goal until it touches on two sides, about both axes and in both directions."""
    inside = 0.8 * place.depth
    path = place.begin().to(0.6, tip=(0, 0, 0.004)).to(1.0, tip=(0, 0, -inside))
    tilt = place.vary(1.0, 0.05) * (place.gap / inside + 0.03)
    for axis in (0, 1):
        for sign in (1.0, -1.0):
            turn = [0.0, 0.0, 0.0]
            turn[axis] = sign * tilt
            path.to(0.9, turn=tuple(turn), pivot=0.5 * inside).to(0.2).to(0.7, turn=(0, 0, 0))
    return path.to(0.8, tip=(0, 0, 0.01), pivot=0.0).to(0.2)


def hard_press(place: Place) -> Path:
    """Press with 60 to 115 N at two places: shows slip in the grip, and compliance."""
    path, first = place.begin(), place.rng.uniform(0, np.pi)
    for angle in (first, first + np.pi):
        _down(path, place.aside * np.cos(angle), place.aside * np.sin(angle), 10.0)
        for force in (60.0, 90.0, place.vary(113.0, 0.02), 60.0, 10.0):
            path.to(0.6, force=(0, 0, -force)).to(0.2)
        _up(path)
    return path.to(0.2)


def tap(place: Place) -> Path:
    """Tap the fixture at two speeds: shows damping and restitution."""
    path, height, deep = place.begin(), 0.008, 0.004
    for speed in (0.012, 0.035):
        for k in range(4):
            angle = 0.5 * np.pi * k + place.rng.uniform(0, 0.4)
            x, y, v = place.aside * np.cos(angle), place.aside * np.sin(angle), place.vary(speed)
            path.to(0.5, tip=(x, y, height))
            path.to((height + deep) / v, "even", tip=(x, y, -deep)).to(0.12)
            path.to(0.35, tip=(x, y, height))
    return path.to(0.2)


def touch_datum(place: Place) -> Path:
    """Touch the table on two sides of the fixture, and the fixture, in the same grip: the table is a datum height."""
    path, height = place.begin(0.05), -float(place.scene.target[2])
    far = place.scene.config.block + 0.06
    for x, y, z in ((-far, 0.0, height), (0.0, far, height), (0.0, place.aside, 0.0)):
        path.to(0.8, tip=(x, y, 0.03))
        path.to(0.6, tip=(x, y, z + NEAR)).to(0.7, tip=(x, y, z), force=(0, 0, -5.0))
        path.to(0.5, force=(0, 0, -place.vary(12.0))).to(0.3)
        path.to(0.6, tip=(x, y, 0.03), force=(0, 0, 0))
    return path.to(0.2)


def mix(place: Place) -> Path:
    """Make a short motion of each kind: free air, a press, a slide, an insertion and a tap."""
    path, r = place.begin(0.06), place.aside
    for turn in ((0.45, 0, 0), (0, 0.45, 0), (0, 0, 0)):
        path.to(0.7, turn=turn)
    _down(path, r, 0.0, 5.0)
    path.to(0.7, force=(0, 0, -place.vary(22.0))).to(0.2).to(0.4, force=(0, 0, -10.0))
    path.to(0.15, force=(0, 3, -10)).to(0.9, "even", tip=(r, 0.014, 0)).to(0.2)
    path.to(0.15, force=(0, -3, -10)).to(0.9, "even", tip=(r, 0, 0)).to(0.2)
    _up(path)
    path.to(0.6, tip=(0.0, 0.0, 0.004)).to(0.9, tip=(0, 0, -0.7 * place.depth))
    for k in range(5):
        at = 0.5 * np.pi * k
        path.to(0.35, force=(10 * np.cos(at), 10 * np.sin(at), 0))
    path.to(0.3, force=(0, 0, 0)).to(0.8, tip=(0, 0, 0.012))
    path.to(0.6, tip=(-r, 0, 0.008)).to(0.4, "even", tip=(-r, 0, -0.004)).to(0.1).to(0.4, tip=(-r, 0, 0.012))
    return path.to(0.2)


def look_and_insert(place: Place) -> Path:
    """Look at the goal from all sides, slide beside it and insert: for errors of joints, wrench and cameras at once.

    While looking, the hand tilts, rolls, approaches and moves sideways at once, each in both directions and at changing
    speed. It turns about the goal, so that a camera on the hand keeps the goal in view.
    """
    path = place.begin(LOOK)
    path.to(0.3, pivot=-LOOK)
    free_side = float(np.sign(quarter(place.scene)))
    for k in range(LOOKS):
        a, b = 2 * np.pi * (np.array([2, 3]) * (k + 1) / LOOKS + place.rng.uniform(-0.03, 0.03))
        side = (place.vary(0.04) * np.sin(2 * a), place.vary(0.045) * np.cos(b), LOOK + place.vary(0.08) * (k % 2))
        lean = (place.vary(0.33) * np.sin(b), place.vary(0.3) * np.sin(a), 0.0)
        roll = free_side * place.vary(0.35) * float(2.2 - np.sin(a - 0.7))
        path.to(place.vary(1.5, 0.2), tip=side, turn=lean, yaw=roll, pivot=-side[2])
    path.to(1.0, tip=(0.0, 0.0, LOOK), turn=(0.0, 0.0, 0.0), yaw=0.0, pivot=-LOOK).to(0.2).to(0.1, pivot=0.0)
    _slid(path, place, place.vary(12.0), int(place.rng.integers(2)), place.vary(0.07))
    return _inserted(path.to(0.5, tip=(0.0, 0.0, OVER), turn=(0.0, 0.0, 0.0)), place)


def _down(path: Path, x: float, y: float, force: float) -> None:
    """Move over (x, y) m and slowly down onto the fixture, and press with `force` N."""
    path.to(0.6, tip=(x, y, 0.006)).to(0.3, tip=(x, y, NEAR))
    path.to(0.6, tip=(x, y, 0.0), force=(0, 0, -2.0)).to(0.4, force=(0, 0, -force)).to(0.15)


def _up(path: Path) -> None:
    """Lift off, straight up."""
    x, y, _ = path.last.tip
    path.to(0.5, tip=(x, y, 0.006), force=(0, 0, 0))


Motions = Mapping[str, Callable[[Place], Path]]
PATHS: Motions = {
    "free": free,
    "press": press,
    "press-elbow": press_elbow,
    "slide": slide,
    "insert": insert,
    "insert-turned": insert_turned,
    "rock": rock,
    "hard-press": hard_press,
    "tap": tap,
    "touch-datum": touch_datum,
    "mix": mix,
    "look-and-insert": look_and_insert,
}
STIFF = {"slide": (600.0, 2400.0)}  # 1/s^2: on a softer spring, stretched by cm, the tip sticks and jumps
TURNED = ("press-elbow",)  # motions with the elbow turned
ROOM = 1.25  # the controller's force limit over the greatest force that the motion asks for


def motion(
    name: str, scene: Scene, config: TaskConfig, rate_hz: float, rng: np.random.Generator, paths: Motions = PATHS
) -> CellMotion:
    """Make the motion of a name for the believed cell.

    Args:
        name: a key of `paths`.
        scene: the believed cell.
        config: settings of its task, whose controller will hold the flange.
        rate_hz: ticks of the controller per second.
        rng: varies the motion.
        paths: the motions of the task, see `vispeg.task.contract.Task.motions`.

    Raises:
        UserError: no such motion, or one that this arm cannot make.
    """
    if name not in paths:
        raise UserError("unknown motion of a cell", key="--motion", got=name, choices=(*paths, "expert"))
    near = elbow_turned(scene) if name in TURNED else posture(scene)
    stiffness = STIFF.get(name, config.stiffness)
    path = with_room(paths[name](Place(scene, rng)), scene, stiffness, near)
    path = paced(path, scene, stiffness, near)
    check_length(sum(leg.seconds for leg in path.legs), rate_hz)
    time, frames = path.frames(rate_hz)
    most = ROOM * float(np.linalg.norm(frames[:, FORCE], axis=1).max())
    ee_cmd = commands(frames, scene, stiffness, near)
    limit = most if most > config.force_limit else None
    return CellMotion(name, time, ee_cmd, limit, STIFF.get(name), near if name in TURNED else None)
