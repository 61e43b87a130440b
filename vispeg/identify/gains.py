"""Joint gains that keep an arm stable at a control rate in every posture of its motion."""

from __future__ import annotations

import numpy as np
from scipy.stats import qmc

from vispeg.identify.excitation import room_of
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import compiled
from vispeg.sim.nominal import Nominal

IIWA_KP = (800.0, 800.0, 300.0, 400.0, 100.0, 60.0, 5.0)  # N m/rad
IIWA_KD = (20.0, 30.0, 6.0, 12.0, 1.5, 0.8, 0.08)  # N m s/rad
STIFFNESS = 25.0  # rad/s, natural frequency of the joint loops of a robot without a gain table
SHARE = 0.3  # of J rate: largest damping of one joint at the centre posture
COUPLED = 1.2  # share of a velocity that all dampings together may remove per tick; at 2 the loop is unstable
POSTURES = 256  # in which the loop must be stable


def servo(robot: RobotModel, centre: np.ndarray, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return joint gains kp (nj,) N m/rad and kd (nj,) N m s/rad that are stable at `rate_hz`.

    The iiwa14 has a table; others get a natural frequency of `STIFFNESS` at their apparent inertia J about `centre`.
    Damping stays under 0.3 J rate_hz, far from the limit 2 J rate_hz of a held command, and under the stable damping in
    postures around `centre` (`bearable`); stiffness is limited to a damping ratio of 0.5 or more.
    """
    inertia = 1.0 / np.diagonal(_mobility(robot, centre[None])[0])
    if robot.name == "iiwa14" and len(inertia) == len(IIWA_KP):
        kp, kd = np.array(IIWA_KP), np.array(IIWA_KD)
    else:
        kp, kd = STIFFNESS**2 * inertia, 2.0 * STIFFNESS * inertia
    most = SHARE * inertia * rate_hz
    most = np.minimum(most, bearable(_mobility(robot, postures(robot, centre)), np.minimum(kd, most), rate_hz))
    return np.minimum(kp, most**2 / inertia), np.minimum(kd, most)


def bearable(mobility: np.ndarray, kd: np.ndarray, rate_hz: float) -> np.ndarray:
    """Return the greatest damping (nj,) N m s/rad, in proportions like those of `kd`, that is stable in all postures.

    A command held for a tick dt multiplies joint velocities by 1 - M^-1 diag(kd) dt: stable while no eigenvalue of
    M^-1 diag(kd) dt reaches 2. They are those of the symmetric A_ij = sqrt(kd_i kd_j) (M^-1)_ij dt, and of diag(s) A
    once kd_i is scaled by s_i. By Gershgorin's theorem none of these exceeds max_i s_i sum_j |A_ij|. With
    s_i = COUPLED / sum_j |A_ij| that is `COUPLED`, under 2.

    Args:
        mobility: M^-1 (n, nj, nj) of n postures.
        kd: desired damping (nj,), positive.
        rate_hz: of control.
    """
    root = np.sqrt(kd / rate_hz)
    rows = np.abs(root[:, None] * mobility * root).sum(axis=2).max(axis=0)  # (nj,)
    return kd * COUPLED / rows


def postures(robot: RobotModel, centre: np.ndarray) -> np.ndarray:
    """Return postures (1 + POSTURES, nj) rad: `centre`, and others spread around it by a Halton sequence."""
    reach = room_of(robot, rate_hz=100.0, duration=1.0).reach  # it depends on neither
    spread = 2.0 * qmc.Halton(len(centre), scramble=False).random(POSTURES) - 1.0
    return np.concatenate([centre[None], centre + reach * spread])


def _mobility(robot: RobotModel, q: np.ndarray) -> np.ndarray:
    """Return the inverse joint inertia (n, nj, nj) at q (n, nj)."""
    return np.linalg.inv(Nominal(compiled(robot), robot.joints, robot.flange, len(q), 1).operational(q)[0])
