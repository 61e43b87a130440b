"""The rewards of the peg task: `shaped`, this project's own, and `paper`, that of a published experiment.

Symbols: p the tip and g the goal in the hole's frame, x = g - p, l the tip's distance from the hole's axis, F the
largest contact force of the step, a the action, each entry within +-1. `shaped` is:

    r_d = -|x| / d0                                   (1)  falls evenly from far away
    r_l = -(1 - exp(-(l / l0)^2 / 2))                 (2)  sharp near the axis, where (1) is flat
    r   = 0.5 r_d + 0.25 r_l - 0.2 (F / F0)^2 + 5 [success] - 5 [abort]   (3)

Every step costs, so that finishing early pays; the force term costs little below 10 N. `paper` is equations (1) to (4)
of Kaspar and Bock, "Reinforcement Learning with Cartesian Commands and Sim to Real Transfer for Peg in Hole Tasks":

    r = -(0.1 |x|_2 + 0.9 |x|_1) - 0.0005 sum_i a_i^2 + 50 [success]   (4)

with x in metres. The paper states no unit. In metres, a whole episode (50 steps) at 9 cm from the goal costs
50 * 0.13 = 6.5, and the bonus of 50 is visible in the return, as the paper says of its Fig. 3. In millimetres it would
cost 6500, and the bonus would be negligible. The norm |x|_1 is taken along the hole's axes.
"""

from __future__ import annotations

from vispeg.task.rewards import Rewards
from vispeg.task.standard_rewards import ACTION, AXIS, DISTANCE, EUCLIDEAN, FORCE, MANHATTAN

ALPHA, BETA, GAMMA = 0.1, 0.9, 0.0005  # 1/m, 1/m, 1: the paper's constants

REWARDS = Rewards(
    (DISTANCE, AXIS, FORCE, EUCLIDEAN, MANHATTAN, ACTION),
    {
        "shaped": {"distance": -0.5, "axis": -0.25, "force": -0.2, "success": 5.0, "abort": -5.0},
        "paper": {"euclidean": -ALPHA, "manhattan": -BETA, "action": -GAMMA, "success": 50.0},
    },
)
