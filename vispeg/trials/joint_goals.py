"""A held flange pose for an arm that takes joint angles alone."""

from __future__ import annotations

import numpy as np

from vispeg.control.laws import rotation_vector, turned
from vispeg.interface.interface import Interface

LEVER = 0.1  # m that a radian counts as, where place and turn cannot both be reached: about a tool's length
DAMPING = 0.03  # m/rad: a direction in which joints move the flange by less is given up, not chased
MARGIN = 0.01  # rad that goals stay away from a limit of the joints, at which a run stops


class JointGoals:
    """Joint angles that move the flange as the policy's controller moves it in free air.

    A reference goes to the commanded pose by the controller's law, a spring and a damper per unit mass; the angles
    follow it by damped least squares (Wampler 1986), with the law's pull towards its posture in what is left, no faster
    and no farther than the joints can.

    Args:
        interface: of the policy: arm, limits, gains.
        q: (nj,) rad, where it begins, at rest.
    """

    def __init__(self, interface: Interface, q: np.ndarray):
        arm, c = interface.arm, interface.controller
        self.chain, self.q = interface.chain, np.array(q, float)
        self.low, self.high, self.fastest = (np.array(x) for x in (arm.low_rad, arm.high_rad, arm.velocity_limit))
        self.kp, self.kd = np.array(c.kp), np.array(c.kd)
        self.home, self.pull = np.array(c.nullspace["q"], float), c.nullspace["kp"] / max(c.nullspace["kd"], 1e-9)
        pose = interface.flange(self.q)
        self.pos, self.rot, self.twist = pose[:3], pose[3:], np.zeros(6)

    def towards(self, pose: np.ndarray, dt: float) -> np.ndarray:
        """Give the angles (nj,) rad after `dt` s more on the way to a flange pose (7,) m and w x y z."""
        error = np.concatenate([pose[:3] - self.pos, rotation_vector(self.rot[None], pose[None, 3:])[0]])
        # the law's step, taken implicitly: stable for every dt
        self.twist = (self.twist + dt * self.kp * error) / (1 + dt * self.kd + dt * dt * self.kp)
        self.pos = self.pos + dt * self.twist[:3]
        self.rot = turned(self.rot[None], dt * self.twist[None, 3:])[0]
        self.rot /= np.linalg.norm(self.rot)
        self.q = self._followed(dt)
        return self.q

    def _followed(self, dt: float) -> np.ndarray:
        """Give the angles nearest to where the flange should be, of those that the joints reach within `dt` s."""
        pos, rot, _, jac = self.chain.pose(self.q[None], 0 * self.q[None])
        weight = np.array([1.0, 1, 1, LEVER, LEVER, LEVER])
        left = weight * np.concatenate([self.pos - pos[0], rotation_vector(rot, self.rot[None])[0]])
        j = weight[:, None] * jac[0]
        low, high = np.minimum(self.low + MARGIN, self.q), np.maximum(self.high - MARGIN, self.q)
        posture = dt * self.pull * (self.home - self.q)
        step, free = np.zeros_like(self.q), np.ones(len(self.q), bool)
        while free.any():  # a joint that ends at its limit stays there, and the others do its part
            aim = left - j[:, ~free] @ step[~free]
            u, s, v = np.linalg.svd(j[:, free], full_matrices=False)
            step[free] = v.T @ (s / (s * s + DAMPING**2) * (u.T @ aim)) + posture[free]
            step[free] -= v.T @ (v @ posture[free])
            wanted = self.q + step
            beyond = free & ((wanted < low) | (wanted > high))
            if not beyond.any():
                break
            step[beyond] = np.clip(wanted, low, high)[beyond] - self.q[beyond]
            free &= ~beyond
        share = np.max(np.abs(step) / (dt * self.fastest))
        return self.q + step / max(1.0, share)  # all slower alike: on the same way
