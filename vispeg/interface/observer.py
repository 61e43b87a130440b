"""Convert a robot's measurements to a policy's observations, and actions to the pose that the robot is to hold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from vispeg.control.laws import rotated, rotation_vector, turned
from vispeg.interface.chain import Chain

DOF = ("x", "y", "z", "rx", "ry", "rz")
DOWN = np.array([0.0, 1.0, 0.0, 0.0])  # flange z straight down, wxyz
BEYOND = 1e-3  # how far an action must be beyond +-1 to count as clipped; rounding to float32 gives up to 1e-5
RECENT = 4  # control periods over which the wrench is averaged, as contact chatters in step with the controller


class Settings(Protocol):
    """The settings of a task that an observer needs; `TaskConfig` and `Interface` have them."""

    @property
    def dof(self) -> Sequence[str]:
        """Directions that the policy moves, a part of DOF."""
        ...

    @property
    def offset(self) -> float:
        """Displacement for an action of 1, m."""
        ...

    @property
    def turn(self) -> float:
        """Rotation for an action of 1, rad."""
        ...

    @property
    def stack(self) -> int:
        """Number of time steps in an observation."""
        ...


class Observer:
    """Measured state and commanded pose of n robots, each in its own episode.

    Args:
        settings: of the task.
        chain: the arm's kinematics, as its controller knows them.
        tip: height of the tip below the flange, m.
        weight: (3,) N in the base, weight that the wrist's sensor carries at rest.
        size: length of the observation vector at one time step.
        n: number of robots.

    Attributes:
        measured: joint angles and velocities, (n, nj) each, rad and rad/s.
        flange, turn: (n, 3) m and (n, 4) wxyz, measured flange pose in the base.
        twist, jac: (n, 6) m/s and rad/s, and (n, 6, nj), of the flange in the base.
        wrench: (n, 6) N and N m, of the tool on the flange without the tool's weight, base axes; 0 at an episode's
            begin.
        action: (n, len(dof)) the last action, within +-1.
        clipped: (n,) number of the episode's actions that were beyond +-1.
        believed: (n, 3) m, position in the base where the goal is believed to be.
        held: (n, 3) m, commanded position of the point that actions move (see `lever`), in the base.
        rot: (n, 4) wxyz, commanded orientation of the flange.
        goal: (n, 3) m, commanded position of the flange.
        straight: (n, 4) wxyz, orientation of the flange straight down.
        stack: observations of the last time steps.
    """

    def __init__(self, settings: Settings, chain: Chain, tip: float, weight: np.ndarray, size: int, n: int = 1):
        self.settings, self.chain, self.length, self.weight, self.n = settings, chain, tip, np.asarray(weight, float), n
        self.turns = any(d.startswith("r") for d in settings.dof)
        self.move = np.array([d in settings.dof for d in DOF])
        self.places = [DOF.index(d) for d in settings.dof]  # index in DOF of each entry of an action
        self.straight = np.tile(DOWN, (n, 1))
        self.goal, self.rot, self.believed = np.zeros((n, 3)), self.straight.copy(), np.zeros((n, 3))
        self.held = self.goal.copy()
        self.action, self.wrench = np.zeros((n, len(settings.dof))), np.zeros((n, 6))
        self.clipped = np.zeros(n, int)
        self.stack = Stack(settings.stack, n, size)

    # Measured -------------------------------------------------------------------------------------------------
    def see(self, q: np.ndarray, dq: np.ndarray) -> None:
        """Store measured joint angles q and velocities dq, (n, nj) rad and rad/s."""
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
        """Return the vector (n, 3) m, base axes, from the flange to the point that actions move and rotate about.

        This point is the tip if the policy rotates the tool, because a rotation about the flange would move the tip
        aside. Otherwise it is the flange itself.

        Args:
            rot: (n, 4) wxyz, orientation of the flange.
        """
        return rotated(rot, np.array([0.0, 0.0, self.length])) if self.turns else np.zeros((self.n, 3))

    def tip(self) -> np.ndarray:
        """Return the measured position of the tip in the base, (n, 3) m.

        For a policy that does not rotate the tool, the tip is taken to be straight below the flange.
        """
        return self.flange + self.lever(self.turn) if self.turns else self.flange - [0, 0, self.length]

    def readings(self) -> np.ndarray:
        """Return readings in SI units, (n, nj + 12), like `observation.state` of rendered datasets.

        They are joint angles, position of the tip, velocity of the flange, force and torque at the flange; all but the
        angles in base axes.
        """
        return np.concatenate([self.measured[0], self.tip(), self.twist[:, :3], self.wrench], axis=1)

    # Commanded ------------------------------------------------------------------------------------------------
    def begin(self, rows: np.ndarray, flange: np.ndarray) -> None:
        """Begin an episode in `rows`, with the flange commanded to `flange` (n, 3) m in the base, straight down."""
        self.goal[rows], self.rot[rows] = flange[rows], DOWN
        self.held[rows] = (self.goal + self.lever(self.rot))[rows]
        self.action[rows], self.wrench[rows], self.clipped[rows] = 0.0, 0.0, 0

    def asked(self, action: np.ndarray) -> np.ndarray:
        """Store an action (n, len(dof)), cut to +-1; return it with an entry for each direction of DOF, (n, 6)."""
        wanted = np.nan_to_num(np.asarray(action, float))
        self.action = np.clip(wanted, -1.0, 1.0)
        self.clipped += (np.abs(wanted - self.action) > BEYOND).any(axis=1)
        motion = np.zeros((self.n, 6))
        motion[:, self.places] = self.action
        return motion

    def offset_by(self, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Convert an action (n, 6), an offset from the measured pose, to the pose to hold.

        Directions that the policy does not move keep their commanded value.

        Returns:
            Position (n, 3) m of the point that actions move, orientation (n, 4) wxyz of the flange; as for `hold`.
        """
        moved = self.flange + self.lever(self.turn) + self.settings.offset * motion[:, :3]
        held, rot = np.where(self.move[:3], moved, self.held), self.rot
        if self.turns:
            rotation = rotation_vector(self.straight, self.turn) + self.settings.turn * motion[:, 3:]
            rot = turned(self.straight, np.where(self.move[3:], rotation, 0.0))
        return held, rot

    def offset_to(self, tip: np.ndarray, turn: np.ndarray | None) -> np.ndarray:
        """Return the action (n, 6) that commands a pose: the inverse of `offset_by`.

        Args:
            tip: (n, 3) m, position of the tip in the base.
            turn: (n, 4) wxyz, orientation of the flange; None to leave the rotation at 0.
        """
        motion = np.zeros((self.n, 6))
        motion[:, :3] = (tip - self.tip()) / self.settings.offset
        if turn is not None:
            rotation = rotation_vector(self.straight, turn) - rotation_vector(self.straight, self.turn)
            motion[:, 3:] = rotation / self.settings.turn
        return motion

    def hold(self, held: np.ndarray, rot: np.ndarray) -> None:
        """Store a commanded pose: `held` (n, 3) m of the point that actions move, `rot` (n, 4) wxyz of the flange."""
        self.held, self.rot = held, rot
        self.goal = held - self.lever(rot)


class Stack:
    """The last `depth` observation vectors (n, size), newest first; an episode begins with its first one repeated."""

    def __init__(self, depth: int, n: int, size: int):
        self.values = np.zeros((depth, n, size))

    def fill(self, rows: np.ndarray, value: np.ndarray) -> None:
        """Fill the stack of some rows with their `value` (n, size)."""
        self.values[:, rows] = value[rows]

    def push(self, value: np.ndarray) -> None:
        """Add an observation (n, size) of every row, and drop the oldest."""
        self.values[1:] = self.values[:-1]
        self.values[0] = np.nan_to_num(value, posinf=0.0, neginf=0.0)

    def flat(self) -> np.ndarray:
        """Return the stack as one vector per row, (n, depth * size)."""
        return np.swapaxes(self.values, 0, 1).reshape(self.values.shape[1], -1)
