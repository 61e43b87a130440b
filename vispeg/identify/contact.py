"""Compare joints in a recording with contact: apply the measured contact to the model, and exclude those samples.

The wrist wrench gives the contact wrench W on the tool (`vispeg.sim.touch`). With the Jacobian J along the measured
motion, J' W are joint torques that act on the simulated arm as on the real one, so that both move alike afterwards.
During contact the force sensor's error would enter, so those samples are excluded, and so are the following ones until
the controller has removed the effect of the contact on the posture. Without contact the wrench has no influence at all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.core.rules import RULES
from vispeg.recordings.recording import Recording
from vispeg.recordings.regimes import Thresholds
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import nominal_of
from vispeg.sim.touch import touch

ROWS = 4096  # samples whose Jacobians are computed at a time
ALWAYS = "the tool touches something all the time: nothing of the joints can be compared"  # an error


@dataclass(frozen=True)
class Contact:
    """External joint torques of a recorded contact.

    Attributes:
        free: (n,) bool, samples that can be compared.
        torque: (n, nj) N m, that the contact makes in the joints; 0 in free air.
    """

    free: np.ndarray
    torque: np.ndarray

    def said(self, name: str) -> str:
        """Return a message for the user."""
        share = f"{100 * float(np.mean(~self.free)):.0f} % of the samples are left out"
        return f"{name}: the tool touches; {share}, and the measured contact force acts on the model's arm there"


def contact_of(rec: Recording, robot: RobotModel) -> Contact | None:
    """Return the contact of a recorded arm; None if there was none, or none is known.

    It is known from the wrist wrench `ft` and from `wrench`, which says how that is to be read. `robot` is the nominal
    arm with its declared tool.
    """
    contact = (
        touch(rec, robot, Thresholds(touch=RULES.touch_light))
        if rec.ft is not None and rec.wrench is not None
        else None
    )
    if contact is None or not contact.touching.any():
        return None
    episode = np.zeros(len(rec.time), int) if rec.episode is None else rec.episode
    free = np.ones(len(rec.time), bool)
    for number in np.unique(episode):
        rows = np.flatnonzero(episode == number)
        free[rows] = ~_since(rec.time[rows], contact.touching[rows], RULES.touch_after)
    wrench, torque = np.nan_to_num(contact.contact), np.zeros(rec.q.shape)
    acting = np.flatnonzero(contact.touching)
    for start in range(0, len(acting), ROWS):
        rows = acting[start : start + ROWS]
        jac = nominal_of(robot, len(rows)).operational(np.nan_to_num(rec.q[rows]))[1]
        torque[rows] = np.einsum("nij,ni->nj", jac, wrench[rows])
    return Contact(free, torque)


def _since(time: np.ndarray, on: np.ndarray, longer: float) -> np.ndarray:
    """Return the samples (n,) bool that are `on` (n,), or at most `longer` s after one that is."""
    last = np.maximum.accumulate(np.where(on, np.arange(len(on)), -1))
    return (last >= 0) & (time - time[last] <= longer)
