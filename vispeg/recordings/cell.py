"""Contact sections of a recording: the believed cell, the convention of its wrench, the outcome of trials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

OPEN_CELL = "peg-cell"  # the cell that each recording states, the default one where it states none
BENCH = "bench"  # what the robot's own file shows, in place of a world
LEVER = 0.05  # m: a sensor's noise of torque over that of force, where only the latter is stated


@dataclass(frozen=True)
class CellBelief:
    """What stands in the cell as the user believes it, in the words of a world file; `vispeg.task.belief` builds it.

    Attributes:
        world: a built-in world's name, the absolute path of a world file, OPEN_CELL or BENCH; "" for the default cell.
        task: what differs from it, keys of a world file's `task`, such as `fixture` and `friction`.
        robot: arm, flange and gripper, as a world file's `robot`; None where the world says it.
        effects: what else is believed, as in a model file: each `effect`, `where`, `params`.
        board: a flat board that lies in sight: `kind`, `columns`, `rows`, `square` (m), for ChArUco `marker` (m) and
            `dictionary`, see `vispeg.render.calibration.Board`; None where there is none.
    """

    world: str = ""
    task: Mapping[str, Any] = field(default_factory=dict)
    robot: Mapping[str, Any] | str | None = None
    effects: tuple[Mapping[str, Any], ...] = ()
    board: Mapping[str, Any] | None = None

    @property
    def open(self) -> bool:
        """Whether it is left to each recording to say what stands there."""
        return self == CellBelief(OPEN_CELL)

    @property
    def bench(self) -> bool:
        """Whether what stands there is in the robot's own file, and no task's."""
        return self.world == BENCH

    def plain(self) -> str | Mapping[str, object]:
        """As a file states it: the world's name alone where that is all."""
        rest = {"task": dict(self.task), "robot": self.robot, "effects": [dict(e) for e in self.effects]}
        rest |= {"board": dict(self.board) if self.board else None}
        rest = {key: value for key, value in rest.items() if value}
        if self.world and not rest:
            return self.world
        return ({"world": self.world} if self.world else {}) | rest


@dataclass(frozen=True)
class WrenchSensor:
    """How `ft` is to be read.

    Attributes:
        frame: whose axes the six numbers are in: the sensor's, fixed to the flange, or the base's.
        acts_on: `tool` for what the flange exerts on the tool (a tool that hangs at rest reads -m g along the flange's
            z), `flange` for its reaction.
        tared: False for raw readings; True where they were zeroed once, so that a constant in the sensor's axes is
            unknown; `weight` where the robot takes the tool's weight off at every pose.
        pos: (3,) m, the point of reference of torques in the flange's frame.
        quat: (4,) w x y z, the sensor's axes in the flange's.
    """

    frame: Literal["flange", "base"] = "flange"
    acts_on: Literal["tool", "flange"] = "tool"
    tared: bool | Literal["weight"] = False
    pos: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quat: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Outcome:
    """How a trial ended.

    Attributes:
        success: whether it did what it should.
        episode: its number in the column `episode`.
        category: of a failure, or `success`.
        peak_force: greatest contact force, N; None where nobody knows.
        depth: of the tip at the end, m; None where nobody knows.
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
        sensor: how they are to be read; what taring took off is not put back.
        rotation: (n, 3, 3) flange to base.

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
    """Turn what the flange exerts on the tool into what the tool exerts on the flange, or back; any shape, N and N m.

    Two sides stand side by side: recordings and laws of motion speak of what the flange exerts on the tool (`acts_on:
    tool`), effects of the wrist's sensor of its reaction (`Effect.wrench`, as a policy is told it). Whoever passes from
    one to the other does it here, or a bias changes its sign on the way.
    """
    return -wrench


def wrench_noise(noise: Mapping[str, float]) -> np.ndarray | None:
    """1-sigma (6,) N and N m of a recording's `noise`; None where nothing is said of forces."""
    if "ft" not in noise:
        return None
    return np.repeat([float(noise["ft"]), float(noise.get("ft_torque", LEVER * noise["ft"]))], 3)
