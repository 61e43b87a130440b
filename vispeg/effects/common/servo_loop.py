"""The control loop inside a position servo, of second order from goal to angle. Its gains are known only to its maker.

`tau = J (w^2 (K goal - q) - 2 zeta w dq)`: on a joint of inertia J without load that is the standard second-order
system with natural frequency w, damping ratio zeta and static gain K. J is the nominal arm's apparent inertia at
the joint, averaged over its postures. It is a constant: the stiffness J w^2 in N m/rad does not change with the arm's
posture, load or true inertia.

Source: Franklin, Powell and Emami-Naeini, Feedback Control of Dynamic Systems, 7th ed., sec. 3.3, eq. (3.55).

Without the effect `servo`, a servo is ideal: fast and critically damped, it follows its goal within 15 ms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FAST = 150.0  # rad/s: natural frequency of the ideal servo


@dataclass
class ServoLoop:
    """The parameters of the loops, each (nsim, nj); effects change them before a rollout begins.

    Attributes:
        frequency: natural frequency, rad/s.
        damping: damping ratio.
        gain: static gain, angle over goal.
        band: half of the dead band, rad: a smaller error makes no torque.
    """

    frequency: np.ndarray
    damping: np.ndarray
    gain: np.ndarray
    band: np.ndarray

    @classmethod
    def ideal(cls, nsim: int, nj: int) -> ServoLoop:
        """Return the ideal servo."""
        return cls(np.full((nsim, nj), FAST), np.ones((nsim, nj)), np.ones((nsim, nj)), np.zeros((nsim, nj)))

    def torque(self, goal, q, dq, inertia, last, x) -> np.ndarray:
        """Return the mean torque (nsim, nj) N m over the next step, by the implicit midpoint rule, stable at any step.

        The acceleration over the step is taken as that of the last step plus the change of torque over the inertia.
        Thus the torque at a joint that dry friction holds at rest settles exactly at the loop's static torque.

        Args:
            goal, q, dq: (nsim, nj) goal in rad, angle in rad and velocity in rad/s that the loop reads.
            inertia: (nsim, nj) reference inertia J, kg m^2, which sets the gains.
            last: (nsim, nj) N m, the torque of the last step; None at the first.
            x: the state of the batch; its `inertia` is the least apparent one over the motion.
        """
        kp, kd, ahead = inertia * self.frequency**2, 2.0 * inertia * self.damping * self.frequency, 0.5 * x.h
        error = self.gain * goal - q - ahead * dq
        error = error - np.clip(error, -self.band, self.band)
        unaccelerated = kp * error - kd * dq
        if last is None:
            return unaccelerated
        fall = kd * ahead + 0.5 * kp * ahead**2  # of the torque, per acceleration over the step
        return (unaccelerated - fall * (x.ddq - last / x.inertia)) / (1.0 + fall / x.inertia)
