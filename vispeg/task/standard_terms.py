"""Observation terms for any task of an arm with a tool: measured tip and wrench, and ground truth for critics.

The goal and the tip are sites of the cell, see Scene.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vispeg.interface.terms import NEAR, SENSED
from vispeg.task.terms import Simulation, Term
from vispeg.worlds.places import MANY


def drawn(effect: str, key: str) -> Callable[[Simulation], np.ndarray]:
    """Return a function that reads an effect's parameter in the present episodes, (n, 1).

    It is the mean over the places at which the world has the effect. It is 0 if the world does not have the effect, and
    the parameter's value for an absent effect in an episode that drew none.
    """

    def read(sim: Simulation) -> np.ndarray:
        where = {e.where for e in sim.world.entries if e.effect == effect}
        active = next((a for a in sim.cell.active if a.effect.name == effect), None)
        if not where or active is None:
            return np.zeros((sim.nsim, 1))
        many = not where.isdisjoint(MANY)
        columns = [i for i, place in enumerate(active.effect.targets(sim.scene)) if many or place in where]
        return active.p[key][:, columns].mean(axis=1, keepdims=True)

    return read


def _goal(sim: Simulation) -> np.ndarray:
    return sim.cell.site_position("goal")


OBSERVED = ("tip", "velocity", "force", "torque", "action", "turn", "spin")
MEASURED = tuple(Term.sensed(SENSED[name]) for name in OBSERVED)
TIP_IN_GOAL = Term("tip_in_goal", lambda sim: sim.tip_in_goal(), 3, "m", NEAR, "critic", "true tip in the goal's frame")
GOAL_AWAY = Term(
    "goal_away", lambda sim: _goal(sim) - sim.nominal_goal, 3, "m", NEAR, "critic", "true minus nominal goal, base axes"
)
MISTAKE = Term(
    "mistake",
    lambda sim: sim.seen.believed - _goal(sim),
    3,
    "m",
    0.003,
    "critic",
    "believed minus true goal, base axes",
)
TRUE_VELOCITY = Term(
    "true_velocity", lambda sim: sim.seen.twist[:, :3], 3, "m/s", 0.1, "critic", "of the flange, base axes"
)
CONTACT = Term(
    "contact", lambda sim: sim.cell.sensors[:, 7:10], 3, "N", 20.0, "teacher", "true contact force, base axes"
)
TILT = Term(
    "tilt", lambda sim: sim.tilt()[:, None], 1, "rad", 0.05, "teacher", "angle between the tip's axis and the goal's"
)
AGE = Term(
    "age",
    lambda sim: (sim.count / sim.config.steps)[:, None],
    1,
    "1",
    1.0,
    "critic",
    "elapsed share of the episode's time",
)
FRICTION = Term(
    "friction", drawn("contact_friction", "scale"), 1, "1", 1.0, "teacher", "drawn scale; 0 in a world without it"
)
MASS = Term(
    "mass",
    drawn("object_mass", "scale"),
    1,
    "1",
    1.0,
    "teacher",
    "drawn scale of the held part's mass; 0 in a world without it",
)
LATENCY = Term(
    "latency",
    drawn("command_delay", "delay"),
    1,
    "s",
    0.02,
    "teacher",
    "drawn delay of commands; 0 in a world without it",
)
