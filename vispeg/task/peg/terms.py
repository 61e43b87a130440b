"""The observation terms of the peg task. Trained policies and critics depend on their order."""

from __future__ import annotations

import numpy as np

from vispeg.task.standard_terms import (
    AGE,
    CONTACT,
    FRICTION,
    GOAL_AWAY,
    LATENCY,
    MASS,
    MEASURED,
    MISTAKE,
    TILT,
    TIP_IN_GOAL,
    TRUE_VELOCITY,
)
from vispeg.task.terms import Term

SLIP = Term("slip", lambda sim: sim.slip()[:, None], 1, "m", 0.003, "teacher", "of the peg in the gripper")
CLEARANCE = Term(
    "clearance",
    lambda sim: np.full((sim.nsim, 1), sim.config.clearance_mm),
    1,
    "mm",
    3.0,
    "teacher",
    "diametral, of the task's settings",
)
TRUTH = (TIP_IN_GOAL, GOAL_AWAY, MISTAKE, TRUE_VELOCITY, CONTACT, SLIP, TILT, AGE, FRICTION, MASS, LATENCY, CLEARANCE)
TERMS = (*MEASURED, *TRUTH)
