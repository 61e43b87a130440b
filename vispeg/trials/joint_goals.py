"""Hold a flange pose with an arm that accepts only joint angles."""

from __future__ import annotations

import numpy as np

from vispeg.control.laws import rotation_vector, turned
from vispeg.interface.interface import Interface

LEVER = 0.1  # m per rad: weight of rotation against position errors if both cannot vanish; about a tool's length
DAMPING = 0.03  # m/rad: directions in which joints move the flange by less are damped, near singularities
MARGIN = 0.01  # rad, distance of goals from the joint limits, at which a run would stop


class JointGoals:
    """Compute joint angles that move the flange as the policy's controller moves it in free air.

    A reference pose moves to the commanded pose by the controller's law, a spring and a damper per unit mass. The
    angles follow it by damped least squares (Wampler 1986), with the law's posture task in the null space, within the
    joints' speed and position limits.

    Args:
        interface: the policy's interface: arm, limits, gains.
        q: (nj,) rad, start posture, at rest.
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
        """Advance by `dt` s towards a flange pose (7,), m and w x y z; return the angles (nj,) rad."""
        error = np.concatenate([pose[:3] - self.pos, rotation_vector(self.rot[None], pose[None, 3:])[0]])
        # implicit integration of the law, stable for every dt
        self.twist = (self.twist + dt * self.kp * error) / (1 + dt * self.kd + dt * dt * self.kp)
        self.pos = self.pos + dt * self.twist[:3]
        self.rot = turned(self.rot[None], dt * self.twist[None, 3:])[0]
        self.rot /= np.linalg.norm(self.rot)
        self.q = self._followed(dt)
        return self.q

    def _followed(self, dt: float) -> np.ndarray:
        """Return the angles that bring the flange nearest to its reference, among those reachable within `dt` s."""
        pos, rot, _, jac = self.chain.pose(self.q[None], 0 * self.q[None])
        weight = np.array([1.0, 1, 1, LEVER, LEVER, LEVER])
        error = weight * np.concatenate([self.pos - pos[0], rotation_vector(rot, self.rot[None])[0]])
        j = weight[:, None] * jac[0]
        low, high = np.minimum(self.low + MARGIN, self.q), np.maximum(self.high - MARGIN, self.q)
        posture = dt * self.pull * (self.home - self.q)
        step, free = np.zeros_like(self.q), np.ones(len(self.q), bool)
        while free.any():  # joints at a limit are fixed there, and the others compensate
            aim = error - j[:, ~free] @ step[~free]
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
        return self.q + step / max(1.0, share)  # all slowed by one factor, so that the path stays the same
