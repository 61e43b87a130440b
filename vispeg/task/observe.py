"""What a policy and a critic see of the task, its sizes, and the stack of the last observations and actions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vispeg.control.laws import rotation_vector
from vispeg.task.config import TaskConfig

if TYPE_CHECKING:
    from vispeg.task.simulation import PegSimulation

TURN = 0.1  # rad, a unit of the turn that a policy sees
PRIVILEGED = 3 + 3 + 3 + 3 + 3 + 1 + 1 + 1 + 4  # see `observation`
CONTACT, PHYSICS = range(12, 17), range(18, 22)  # its entries: contact force, slip and tilt; see `_physics`


def turns(config: TaskConfig) -> bool:
    """Whether the policy moves any rotation."""
    return any(d.startswith("r") for d in config.dof)


def policy_size(config: TaskConfig) -> int:
    """Numbers in one observation of the policy: relative position, velocity, force, torque, last action.

    A policy that turns the flange also sees how it is turned from straight down, and how fast.
    """
    return 12 + len(config.dof) + 6 * turns(config)


class Stack:
    """The last `depth` observations (nsim, size), newest first; a row that begins repeats its first one."""

    def __init__(self, depth: int, nsim: int, size: int):
        self.values = np.zeros((depth, nsim, size))

    def fill(self, rows: np.ndarray, value: np.ndarray) -> None:
        """Rows begin anew with their `value` (nsim, size)."""
        self.values[:, rows] = value[rows]

    def push(self, value: np.ndarray) -> None:
        """One more observation (nsim, size) of every row."""
        self.values[1:] = self.values[:-1]
        self.values[0] = value

    def flat(self) -> np.ndarray:
        """(nsim, depth size)."""
        return np.swapaxes(self.values, 0, 1).reshape(self.values.shape[1], -1)


def policy_part(sim: PegSimulation) -> np.ndarray:
    """(nsim, d): measured tip relative to the believed hole, velocity, wrench, last action, all near 1.

    Where the policy turns the flange: its rotation vector from straight down, and its angular velocity.
    """
    tip = sim.flange + sim.lever(sim.turn) if turns(sim.config) else sim.flange - [0, 0, sim.scene.tip]
    parts = [
        (tip - sim.believed) / 0.03,
        sim.twist[:, :3] / 0.1,
        sim.wrench[:, :3] / 20.0,
        sim.wrench[:, 3:] / 2.0,
        sim.action,
    ]
    if turns(sim.config):
        parts += [rotation_vector(sim.straight, sim.turn) / TURN, sim.twist[:, 3:] / 0.5]
    return np.concatenate(parts, axis=1)


def observation(sim: PegSimulation) -> dict[str, np.ndarray]:
    """`policy` (nsim, stack d) and `privileged` (nsim, PRIVILEGED), float32."""
    tip, hole = np.nan_to_num(sim.tip_in_hole()), sim.cell.site_position("hole")
    truth = [
        tip / 0.03,
        (hole - sim.nominal_hole) / 0.03,
        (sim.believed - hole) / 0.003,
        np.nan_to_num(sim.twist[:, :3]) / 0.1,
        np.nan_to_num(sim.cell.sensors[:, 7:10]) / 20.0,
        np.nan_to_num(sim.cell.qpos[:, [sim.cell.slip]]) / 0.003,
        np.nan_to_num(sim.tilt())[:, None] / 0.05,
        (sim.count / sim.config.steps)[:, None],
        _physics(sim),
    ]
    privileged = np.clip(np.concatenate(truth, axis=1), -20, 20).astype(np.float32)
    return {"policy": np.clip(sim.stack.flat(), -20, 20).astype(np.float32), "privileged": privileged}


def _physics(sim: PegSimulation) -> np.ndarray:
    """Physics (nsim, 4) that a critic may know: friction and mass scale, latency, clearance; near 1."""
    p = {a.effect.name: a.p for a in sim.cell.active}
    out = np.zeros((sim.nsim, 4))
    for column, (name, key, scale) in enumerate(
        (("contact_friction", "scale", 1.0), ("object_mass", "scale", 1.0), ("command_delay", "delay", 0.02))
    ):
        if name in p and key in p[name]:
            out[:, column] = p[name][key].mean(axis=1) / scale
    out[:, 3] = sim.config.clearance_mm / 3.0
    return out
