"""Terms that any task of an arm with a tool can be observed by: its tip, its wrench, and what critics may know.

The goal and the tip are sites of the cell, see Scene.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from vispeg.control.laws import rotation_vector
from vispeg.task.terms import Term
from vispeg.worlds.places import MANY

if TYPE_CHECKING:
    from vispeg.task.environments.simulation import TaskSimulation

NEAR = 0.03  # m, a unit of positions near the goal


def _tip(sim: TaskSimulation) -> np.ndarray:
    tip = sim.flange + sim.lever(sim.turn) if sim.config.turns else sim.flange - [0, 0, sim.scene.tip]
    return tip - sim.believed


def drawn(effect: str, key: str) -> Callable[[TaskSimulation], np.ndarray]:
    """Read what an episode drew of an effect's parameter (n, 1): the mean over the places at which the world draws it.

    0 in worlds without the effect; its null in an episode that goes without.
    """

    def read(sim: TaskSimulation) -> np.ndarray:
        where = {e.where for e in sim.world.entries if e.effect == effect}
        for a in sim.cell.active if where else ():
            if a.effect.name == effect:
                many = not where.isdisjoint(MANY)
                columns = [i for i, place in enumerate(a.effect.targets(sim.scene)) if many or place in where]
                return a.p[key][:, columns].mean(axis=1, keepdims=True)
        return np.zeros((sim.nsim, 1))

    return read


def _goal(sim: TaskSimulation) -> np.ndarray:
    return sim.cell.site_position("goal")


MEASURED = (
    Term("tip", _tip, 3, "m", NEAR, "policy", "measured tip less where the goal is believed to be, base axes"),
    Term("velocity", lambda sim: sim.twist[:, :3], 3, "m/s", 0.1, "policy", "of the flange, base axes"),
    Term("force", lambda sim: sim.wrench[:, :3], 3, "N", 20.0, "policy", "at the wrist, base axes, tool's weight off"),
    Term("torque", lambda sim: sim.wrench[:, 3:], 3, "N m", 2.0, "policy", "at the wrist, base axes"),
    Term("action", lambda sim: sim.action, lambda c: len(c.dof), "1", 1.0, "policy", "the last action"),
    Term(
        "turn",
        lambda sim: rotation_vector(sim.straight, sim.turn),
        3,
        "rad",
        0.1,
        "policy",
        "rotation vector of the flange from straight down; of policies that turn it",
        when=lambda c: c.turns,
    ),
    Term(
        "spin",
        lambda sim: sim.twist[:, 3:],
        3,
        "rad/s",
        0.5,
        "policy",
        "angular velocity of the flange; of policies that turn it",
        when=lambda c: c.turns,
    ),
)
TIP_IN_GOAL = Term("tip_in_goal", lambda sim: sim.tip_in_goal(), 3, "m", NEAR, "critic", "true tip in the goal's frame")
GOAL_AWAY = Term(
    "goal_away", lambda sim: _goal(sim) - sim.nominal_goal, 3, "m", NEAR, "critic", "true less nominal goal, base axes"
)
MISTAKE = Term(
    "mistake", lambda sim: sim.believed - _goal(sim), 3, "m", 0.003, "critic", "believed less true goal, base axes"
)
TRUE_VELOCITY = Term("true_velocity", lambda sim: sim.twist[:, :3], 3, "m/s", 0.1, "critic", "of the flange, base axes")
CONTACT = Term(
    "contact", lambda sim: sim.cell.sensors[:, 7:10], 3, "N", 20.0, "teacher", "true contact force, base axes"
)
TILT = Term(
    "tilt", lambda sim: sim.tilt()[:, None], 1, "rad", 0.05, "teacher", "angle between the tip's axis and the goal's"
)
AGE = Term(
    "age", lambda sim: (sim.count / sim.config.steps)[:, None], 1, "1", 1.0, "critic", "share of the time that is gone"
)
FRICTION = Term("friction", drawn("contact_friction", "scale"), 1, "1", 1.0, "teacher", "scale drawn, 0 if none is")
MASS = Term("mass", drawn("object_mass", "scale"), 1, "1", 1.0, "teacher", "scale of the held part's, 0 if none is")
LATENCY = Term("latency", drawn("command_delay", "delay"), 1, "s", 0.02, "teacher", "of commands, 0 if none is drawn")
