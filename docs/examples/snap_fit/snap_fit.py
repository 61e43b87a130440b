"""A plug with a sprung latch that snaps into a socket: a task of one's own, outside the package.

The nose of the latch sticks out of the plug's side. The lip of the socket pushes it back, and behind the lip it springs
out again: the plug is in once it is deep enough and its latch is out. Docs: "Your own task".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.interface.observer import DOF
from vispeg.robots.declare import RobotConfig
from vispeg.robots.scene import CAMERAS, Scene, build
from vispeg.robots.scene_config import SceneConfig
from vispeg.task.config import TaskConfig, Tolerance
from vispeg.task.contract import Task
from vispeg.task.environments.track import Track
from vispeg.task.guards import CATEGORIES as GUARDED
from vispeg.task.rewards import Rewards, RewardTerm
from vispeg.task.standard_rewards import STANDARD
from vispeg.task.standard_terms import AGE, CONTACT, GOAL_AWAY, MEASURED, MISTAKE, TIP_IN_GOAL, TRUE_VELOCITY
from vispeg.task.terms import Observation, Simulation, Term

WIDTH, DEPTH, LIP = 0.016, 0.020, 0.006  # m: plug and socket, and how thick the lip is
NOSE, HEIGHT, OUT = 0.002, 0.008, 0.0015  # m: radius of the nose, its height above the tip, how far it sticks out
SNAPPED = 0.0004  # m, how far back the latch may still be when it counts as out


def latch(sim: Simulation) -> np.ndarray:
    """How far (nsim,) m the latch is pushed back."""
    return -sim.cell.qpos[:, sim.cell.model.joint("latch").qposadr[0]]


PUSHED = RewardTerm("pushed", lambda m: np.abs(latch(m.sim)) / OUT, "how far the latch is pushed back, 1 if flush")
REWARDS = Rewards(
    (*STANDARD, PUSHED),
    {"shaped": {"distance": -0.5, "axis": -0.25, "force": -0.2, "pushed": -0.1, "success": 5.0, "abort": -5.0}},
)
LATCH = Term("latch", lambda sim: latch(sim)[:, None], 1, "m", OUT, "teacher", "how far the latch is pushed back")


@dataclass(frozen=True, kw_only=True)
class SnapConfig(TaskConfig):
    """Settings beside those of every task.

    Attributes:
        clearance_mm: width of the socket less width of the plug.
        spring: of the latch, N/m.
        fixture: centre of the socket's mouth, base frame, m.
    """

    rewards: ClassVar[Rewards] = REWARDS
    tolerance: ClassVar[Tolerance | None] = Tolerance("clearance_mm", "clearance")
    clearance_mm: float = 1.0
    spring: float = 3000.0
    fixture: tuple[float, float, float] = SceneConfig.fixture

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 100 <= self.spring <= 20000:
            raise UserError("impossible latch", key="spring", expected="100 to 20000 N/m", got=self.spring)


@lru_cache(maxsize=8)
def cell(
    robot: RobotConfig,
    clearance_mm: float,
    spring: float,
    fixture: tuple[float, float, float],
    cameras: tuple[str, ...],
) -> Scene:
    """Give the package's cell with a square plug, a latch in it, and a lip in the socket's wall on the latch's side."""
    shape = SceneConfig(
        robot=robot, shape="square", clearance_mm=clearance_mm, diameter=WIDTH, depth=DEPTH, fixture=fixture
    )
    scene = build(shape, cameras)
    spec = scene.spec()
    plug, tip = spec.body("peg"), spec.site("peg_tip")
    x, z = WIDTH / 2 + OUT - NOSE, tip.pos[2] - HEIGHT  # the tip's z axis points the way in
    body = plug.add_body(name="latch", pos=(x, 0, z))
    joint = body.add_joint(name="latch", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(1, 0, 0), range=(-2 * OUT, 0))
    joint.limited, joint.springref = True, 0.0
    joint.damping, joint.stiffness = (np.array([value, 0.0, 0.0]) for value in (20.0, spring))
    joint.armature = 0.2  # kg: a contact's stiffness grows with the inertia that it meets
    nose = body.add_geom(name="nose", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(NOSE, 0, 0), mass=0.005, material="peg")
    nose.contype, nose.conaffinity, nose.priority, nose.friction = 1, 1, 1, (0.2, 0.002, 1e-5)
    nose.solref, nose.solimp = (0.004, 1.0), (0.95, 0.99, 2e-4, 0.5, 2.0)  # as the plug's
    _lip(spec, shape)
    return replace(scene, build=spec.copy, parts={**scene.parts, "peg": ("peg", "nose")})


def _lip(spec: mujoco.MjSpec, shape: SceneConfig) -> None:
    """End the wall that the latch meets below the lip: behind it there is room for the nose."""
    socket = spec.body("fixture")
    for geom in list(socket.geoms):
        if geom.name == "hole_wall0":  # the one at +x, which is the plug's +x too
            spec.delete(geom)
    half, wall = shape.apothem, {"type": mujoco.mjtGeom.mjGEOM_BOX, "contype": 1, "conaffinity": 0, "group": 3}
    for x0, x1, z0, z1 in ((half, 0.03, -LIP, 0.0), (half + 2 * OUT, 0.03, -DEPTH, -LIP)):
        size, pos = ((x1 - x0) / 2, half, (z1 - z0) / 2), ((x0 + x1) / 2, 0, (z0 + z1) / 2)
        socket.add_geom(size=size, pos=pos, **wall)


@dataclass
class SnapTrack(Track):
    """Judges an episode: in means deep with the latch out."""

    back: float = 0.0

    def add(
        self, config: SnapConfig, forces: np.ndarray, tip: np.ndarray, back: float = 0.0, **observed: float
    ) -> None:
        super().add(config, forces, tip)
        self.back = back

    def verdict(self, config: SnapConfig) -> str | None:
        if self.peak > config.force_abort:
            return "force limit"
        deep = self.depths[-1] > HEIGHT + LIP and self.lateral < WIDTH / 2
        return "success" if deep and abs(self.back) < SNAPPED else None

    def at_time(self, config: SnapConfig) -> str:
        if max(self.depths) > 0.002 and self.lateral < WIDTH / 2:
            return "not latched"
        return "search" if self.touched else "approach"


class Push:
    """The scripted expert: over the socket, then straight down."""

    def __init__(self, config: SnapConfig):
        self.config, self.observed = config, Observation(SnapFit.terms, config)

    def reset(self, rows: np.ndarray) -> None:
        """Remember nothing."""

    def act(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        tip = self.observed.term("tip").scale * observation["policy"][:, self.observed["tip"]].astype(float)
        over = np.hypot(tip[:, 0], tip[:, 1]) < 0.001
        move = np.zeros((len(tip), len(DOF)))
        move[:, :2], move[:, 2] = -tip[:, :2], np.where(over | (tip[:, 2] < 0), -0.01, 0.005 - tip[:, 2])
        return np.clip(move[:, [DOF.index(d) for d in self.config.dof]] / self.config.offset, -1, 1).astype(np.float32)


class SnapFit(Task):
    """See the module."""

    label, title, Config = "snap_fit", "Push the plug into the socket until it snaps in.", SnapConfig
    terms = (*MEASURED, TIP_IN_GOAL, GOAL_AWAY, MISTAKE, TRUE_VELOCITY, CONTACT, AGE, LATCH)
    categories = ("success", "approach", "search", "not latched", "force limit", "diverged", *GUARDED)

    def cell(self, config: SnapConfig, cameras: tuple[str, ...] | None = None) -> Scene:
        named = CAMERAS if cameras is None else cameras
        return cell(config.robot, config.clearance_mm, config.spring, config.fixture, named)

    def goal(self, config: SnapConfig) -> np.ndarray:
        return np.array([0.0, 0.0, -(HEIGHT + LIP + NOSE)])

    def within(self, config: SnapConfig) -> float:
        return WIDTH / 2

    def track(self) -> SnapTrack:
        return SnapTrack()

    def observed(self, sim: Simulation) -> Mapping[str, np.ndarray]:
        return {"back": latch(sim)}

    def expert(self, config: SnapConfig, nsim: int) -> Push:
        return Push(config)
