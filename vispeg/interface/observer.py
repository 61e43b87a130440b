"""From what a robot measures to what a policy sees, and from an action to the pose that the robot is to hold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from vispeg.control.laws import rotated, rotation_vector, turned
from vispeg.interface.chain import Chain

DOF = ("x", "y", "z", "rx", "ry", "rz")
DOWN = np.array([0.0, 1.0, 0.0, 0.0])  # flange z straight down, wxyz
BEYOND = 1e-3  # of an action of 1, by which one counts as cut: readings in float32 give 1e-5
RECENT = 4  # control periods over whose mean the wrench is told: contact chatters in step with the controller


class Settings(Protocol):
    """What an observer needs to know of the task: `TaskConfig` and `Interface` both say it.

    Attributes:
        dof: directions that the policy moves, of DOF.
        offset, turn: of an action of 1, m and rad.
        stack: moments that the policy is told.
    """

    @property
    def dof(self) -> Sequence[str]: ...  # noqa: D102
    @property
    def offset(self) -> float: ...  # noqa: D102
    @property
    def turn(self) -> float: ...  # noqa: D102
    @property
    def stack(self) -> int: ...  # noqa: D102


class Observer:
    """n robots at once, each in an episode of its own.

    Args:
        settings: of the task.
        chain: the arm, as its controller knows it.
        tip: of the tool below the flange, m.
        weight: (3,) N in the base, that the wrist's sensor carries at rest.
        size: numbers of one moment.
        n: robots.

    Attributes:
        flange, turn: (n, 3) m, (n, 4) wxyz: the measured pose in the base; `twist` (n, 6) and `jac` (n, 6, nj) there.
        wrench: (n, 6) N and N m that the tool puts on the flange, base axes, the tool's weight off; 0 as an episode
            begins.
        action: (n, len(dof)) the last one; `clipped` (n,) how many of the episode's were beyond what is taken.
        believed: (n, 3) m, where the goal is believed to be, base.
        held, rot: (n, 3) m, (n, 4): the pose that is asked for of the point that actions move; `goal` (n, 3) of the
            flange.
        straight: (n, 4) the flange straight down.
        stack: the last moments.
    """

    def __init__(self, settings: Settings, chain: Chain, tip: float, weight: np.ndarray, size: int, n: int = 1):
        self.settings, self.chain, self.length, self.weight, self.n = settings, chain, tip, np.asarray(weight, float), n
        self.turns = any(d.startswith("r") for d in settings.dof)
        self.move = np.array([d in settings.dof for d in DOF])
        self.places = [DOF.index(d) for d in settings.dof]  # of an action's entries among all directions
        self.straight = np.tile(DOWN, (n, 1))
        self.goal, self.rot, self.believed = np.zeros((n, 3)), self.straight.copy(), np.zeros((n, 3))
        self.held = self.goal.copy()
        self.action, self.wrench = np.zeros((n, len(settings.dof))), np.zeros((n, 6))
        self.clipped = np.zeros(n, int)
        self.stack = Stack(settings.stack, n, size)

    # Measured -------------------------------------------------------------------------------------------------
    def see(self, q: np.ndarray, dq: np.ndarray) -> None:
        """Note that the arms stand at q and move at dq, (n, nj) rad and rad/s."""
        self.measured = q, dq
        self.flange, self.turn, self.twist, self.jac = self.chain.pose(q, dq)

    def feel(self, recent: np.ndarray) -> None:
        """Store the wrenches of the wrists' sensors; call it after `see`.

        Args:
            recent: (k, n, 6) N and N m of the last control periods (`RECENT`): wrench of the tool on the flange, in the
                flange's axes and about its origin, the tool's weight included.
        """
        wrench, turn = np.nan_to_num(recent.mean(axis=0)), self.turn
        self.wrench = np.concatenate([rotated(turn, wrench[:, :3]) - self.weight, rotated(turn, wrench[:, 3:])], axis=1)

    def lever(self, rot: np.ndarray) -> np.ndarray:
        """From the flange to the point that actions move and turn about, (n, 3) m: the tip of a tool held straight
        where the policy turns it, else the flange itself. A turn about the flange would throw the tip aside."""
        return rotated(rot, np.array([0.0, 0.0, self.length])) if self.turns else np.zeros((self.n, 3))

    def tip(self) -> np.ndarray:
        """(n, 3) m in the base, as measured. Of a policy that does not turn the tool, straight below the flange."""
        return self.flange + self.lever(self.turn) if self.turns else self.flange - [0, 0, self.length]

    def readings(self) -> np.ndarray:
        """Return readings in SI units, (n, nj + 12), as rendered datasets hold them in `observation.state`: angles of
        the joints, place and velocity of the tool's tip in the base, force and torque at the flange.
        """
        return np.concatenate([self.measured[0], self.tip(), self.twist[:, :3], self.wrench], axis=1)

    # Commanded ------------------------------------------------------------------------------------------------
    def begin(self, rows: np.ndarray, flange: np.ndarray) -> None:
        """Rows begin an episode with the flange asked to be at `flange` (n, 3) m, straight down."""
        self.goal[rows], self.rot[rows] = flange[rows], DOWN
        self.held[rows] = (self.goal + self.lever(self.rot))[rows]
        self.action[rows], self.wrench[rows], self.clipped[rows] = 0.0, 0.0, 0

    def asked(self, action: np.ndarray) -> np.ndarray:
        """Take note of an action (n, len(dof)); return it within +-1 among all directions, (n, 6)."""
        wanted = np.nan_to_num(np.asarray(action, float))
        self.action = np.clip(wanted, -1.0, 1.0)
        self.clipped += (np.abs(wanted - self.action) > BEYOND).any(axis=1)
        motion = np.zeros((self.n, 6))
        motion[:, self.places] = self.action
        return motion

    def offset_by(self, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where an action (n, 6), an offset from where the arm is, puts the held point and the flange's turn.

        Directions that the policy does not move are held.
        """
        moved = self.flange + self.lever(self.turn) + self.settings.offset * motion[:, :3]
        held, rot = np.where(self.move[:3], moved, self.held), self.rot
        if self.turns:
            asked = rotation_vector(self.straight, self.turn) + self.settings.turn * motion[:, 3:]
            rot = turned(self.straight, np.where(self.move[3:], asked, 0.0))
        return held, rot

    def offset_to(self, tip: np.ndarray, turn: np.ndarray | None = None) -> np.ndarray:
        """Return the action (n, 6) that asks for the tip at (n, 3) m and the flange turned by (n, 4): `offset_by`
        undone.
        """
        motion = np.zeros((self.n, 6))
        motion[:, :3] = (tip - self.tip()) / self.settings.offset
        if turn is not None:
            asked = rotation_vector(self.straight, turn) - rotation_vector(self.straight, self.turn)
            motion[:, 3:] = asked / self.settings.turn
        return motion

    def hold(self, held: np.ndarray, rot: np.ndarray) -> None:
        """Note that the held point is asked to be at `held` (n, 3) m, the flange turned by `rot` (n, 4)."""
        self.held, self.rot = held, rot
        self.goal = held - self.lever(rot)


class Stack:
    """The last `depth` observations (n, size), newest first; a row that begins repeats its first one."""

    def __init__(self, depth: int, n: int, size: int):
        self.values = np.zeros((depth, n, size))

    def fill(self, rows: np.ndarray, value: np.ndarray) -> None:
        """Reset rows to their `value` (n, size)."""
        self.values[:, rows] = value[rows]

    def push(self, value: np.ndarray) -> None:
        """One more observation (n, size) of every row."""
        self.values[1:] = self.values[:-1]
        self.values[0] = np.nan_to_num(value, posinf=0.0, neginf=0.0)

    def flat(self) -> np.ndarray:
        """(n, depth size)."""
        return np.swapaxes(self.values, 0, 1).reshape(self.values.shape[1], -1)
