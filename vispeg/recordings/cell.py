"""Contact sections of a recording: the believed cell, the convention of the wrench signal, the outcomes of trials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

OPEN_CELL = "peg-cell"  # stands for the cell that each recording states, or the default cell where it states none
BENCH = "bench"  # no world: the scene is the one in the robot's own file
LEVER = 0.05  # m: assumed ratio of a sensor's torque noise to its force noise, where only the latter is stated


@dataclass(frozen=True)
class CellBelief:
    """The user's belief about the cell, in the keys of a world file; `vispeg.task.belief` builds the model from it.

    Attributes:
        world: a built-in world's name, the absolute path of a world file, OPEN_CELL or BENCH; "" for the default cell.
        task: overrides of the world: keys of a world file's `task`, such as `fixture` and `friction`.
        robot: arm, flange and gripper, as in a world file's `robot`; None where the world states it.
        effects: further believed effects, as in a model file: `effect`, `where` and `params` each.
        board: a flat calibration board in view: `kind`, `columns`, `rows`, `square` (m), for ChArUco `marker` (m) and
            `dictionary`, see `vispeg.render.calibration.Board`; None if there is none.
    """

    world: str = ""
    task: Mapping[str, Any] = field(default_factory=dict)
    robot: Mapping[str, Any] | str | None = None
    effects: tuple[Mapping[str, Any], ...] = ()
    board: Mapping[str, Any] | None = None

    @property
    def open(self) -> bool:
        """Whether each recording states its own cell."""
        return self == CellBelief(OPEN_CELL)

    @property
    def bench(self) -> bool:
        """Whether the scene is the one in the robot's own file, without a task."""
        return self.world == BENCH

    def plain(self) -> str | Mapping[str, object]:
        """Return the belief as a file states it: the world's name alone if nothing else is stated."""
        rest = {"task": dict(self.task), "robot": self.robot, "effects": [dict(e) for e in self.effects]}
        rest |= {"board": dict(self.board) if self.board else None}
        rest = {key: value for key, value in rest.items() if value}
        if self.world and not rest:
            return self.world
        return ({"world": self.world} if self.world else {}) | rest


@dataclass(frozen=True)
class WrenchSensor:
    """Convention of the wrench signal `ft`.

    Attributes:
        frame: axes of the six components: the sensor's, which is fixed to the flange, or the base's.
        acts_on: `tool` if `ft` is the wrench that the flange exerts on the tool (a tool that hangs at rest reads -m g
            along the flange's z), `flange` if it is the reaction to that.
        tared: False for raw readings; True if they were zeroed once, so that a constant offset in the sensor's axes is
            unknown; `weight` if the robot subtracts the tool's weight at every pose.
        pos: (3,) m, reference point of the torques in the flange frame.
        quat: (4,) w x y z, orientation of the sensor in the flange frame.
    """

    frame: Literal["flange", "base"] = "flange"
    acts_on: Literal["tool", "flange"] = "tool"
    tared: bool | Literal["weight"] = False
    pos: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quat: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Outcome:
    """Outcome of a trial.

    Attributes:
        success: whether the task was achieved.
        episode: its number in the column `episode`.
        category: category of the failure, or `success`.
        peak_force: greatest contact force, N; None if not known.
        depth: depth of the tip below the mouth that it enters, m: the greatest of a simulated run, else as recorded;
            None if not known.
    """

    success: bool
    episode: int = 0
    category: str = ""
    peak_force: float | None = None
    depth: float | None = None


def canonical(ft: np.ndarray, sensor: WrenchSensor, rotation: np.ndarray) -> np.ndarray:
    """Return the wrench of the flange on the tool, about the flange's origin, flange axes.

    Args:
        ft: (n, 6) N and N m as recorded.
        sensor: their convention; an offset removed by taring is not restored.
        rotation: (n, 3, 3) rotation from flange to base axes.

    Returns:
        (n, 6) N, N m.
    """
    from scipy.spatial.transform import Rotation

    sign = 1.0 if sensor.acts_on == "tool" else -1.0
    force, torque = sign * ft[:, :3], sign * ft[:, 3:]
    if sensor.frame == "base":
        force, torque = (np.einsum("nji,nj->ni", rotation, v) for v in (force, torque))
    else:
        turn = Rotation.from_quat(np.array(sensor.quat), scalar_first=True).as_matrix()
        force, torque = force @ turn.T, torque @ turn.T
    return np.concatenate([force, torque + np.cross(np.array(sensor.pos), force)], axis=1)


def reaction(wrench: np.ndarray) -> np.ndarray:
    """Convert the wrench of the flange on the tool to that of the tool on the flange, or back; any shape, N and N m.

    Two sign conventions are in use. `canonical`, equations of motion and simulated recordings have the wrench of the
    flange on the tool; effects of the wrist sensor (`Effect.wrench`) and policies have its reaction. Other recordings
    state theirs (`WrenchSensor.acts_on`): `canonical` converts from it, and `vispeg.trials.ros2_robot.as_read` to it.
    """
    return -wrench


def wrench_noise(noise: Mapping[str, float]) -> np.ndarray | None:
    """Return the 1-sigma noise (6,) N and N m from a recording's `noise`; None if it states none for `ft`."""
    if "ft" not in noise:
        return None
    return np.repeat([float(noise["ft"]), float(noise.get("ft_torque", LEVER * noise["ft"]))], 3)
