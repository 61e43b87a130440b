"""Safety limits that stop the arm: joints, speed, force and workspace, checked in every control period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.core.errors import UserError
from vispeg.interface.interface import Interface
from vispeg.interface.observer import Observer

JOINT, VELOCITY, SPEED = "joint limit", "joint velocity", "speed limit"
FORCE, WORKSPACE, WATCHDOG, STOPPED = "force limit", "workspace", "watchdog", "stopped"
# m: top of the workspace above the goal, and its bottom below the depth that counts as success
ABOVE, BELOW = 0.30, 0.02
SPEED_MS = 0.25  # m/s: reduced speed of ISO 10218-1, for a person next to the arm
REACH = 0.15  # m: twice the largest horizontal distance of starts, and shift of goals, in the built-in worlds


@dataclass(frozen=True)
class Limits:
    """Safety limits of a run, beyond which the arm stops.

    Attributes:
        force: force on the wrist, minus the tool's weight, at which the arm stops, N; default: the task's.
        speed: speed of the tip at which the arm stops, m/s.
        reach: horizontal distance of the tip from the goal at which the arm stops, m.
        no_force_limit: allow a robot that measures no force, so that no force limit can act.
    """

    force: float | None = None
    speed: float = SPEED_MS
    reach: float = REACH
    no_force_limit: bool = False

    def __post_init__(self) -> None:
        for key, most in (("force", 1000.0), ("speed", 2.0), ("reach", 2.0)):
            value = getattr(self, key)
            if value is not None and not 0 < value <= most:
                raise UserError("out of bounds", key=f"--{key}", expected=f"above 0, up to {most:g}", got=value)
        if self.no_force_limit and self.force is not None:
            raise UserError("contradict each other", key="--force, --no-force-limit", expected="one of them")

    def fit(self, interface: Interface, felt: bool) -> None:
        """Raise UserError if these limits cannot protect the robot; `felt` tells whether it measures forces."""
        if felt and self.no_force_limit:
            raise UserError("is for robots that measure no force", key="--no-force-limit", expected="--force")
        if not felt and interface.feels:
            what = "the policy observes force and torque, but the robot measures neither"
            raise UserError(what, key="--robot", expected="a policy that does not, or a robot with a sensor")
        if not felt and not self.no_force_limit:
            what = "the robot measures no force, so no force limit can act"
            raise UserError(what, key="--robot", expected="--no-force-limit, if that is safe")

    def shares(self, interface: Interface, seen: Observer, force: float | None) -> dict[str, float]:
        """Return how much of each limit the current state uses: limit -> share, 1 at the limit.

        The first limit above 1 is the reason to stop. `force` is the contact force on the wrist, N; None if unmeasured.
        """
        arm, (q, dq) = interface.arm, seen.measured
        low, high = np.array(arm.low_rad), np.array(arm.high_rad)
        half = np.where(np.isfinite(high - low), (high - low) / 2, np.pi)
        lever = seen.tip()[0] - seen.flange[0]
        speed = np.linalg.norm(seen.twist[0, :3] + np.cross(seen.twist[0, 3:], lever))
        out = {
            JOINT: np.max(1 + np.maximum(low - q[0], q[0] - high) / half),
            VELOCITY: np.max(np.abs(dq[0]) / arm.velocity_limit),
            SPEED: speed / self.speed,
            **({} if force is None else {FORCE: force / (self.force or interface.force_abort_n)}),
            WORKSPACE: self._workspace(interface, seen, seen.tip()[0]),
        }
        return {name: max(0.0, float(share)) for name, share in out.items()}

    def broken(self, interface: Interface, seen: Observer, force: float | None) -> str | None:
        """Return the first limit that the state exceeds, `WATCHDOG` for readings that are not finite, or None."""
        if not all(np.isfinite(x).all() for x in (*seen.measured, force or 0.0)):
            return WATCHDOG
        return next((name for name, share in self.shares(interface, seen, force).items() if share > 1), None)

    def inside(self, interface: Interface, seen: Observer, tip: np.ndarray) -> bool:
        """Return whether a tip (3,), m, is within the workspace: a cylinder above the believed goal."""
        return self._workspace(interface, seen, tip) <= 1

    def _workspace(self, interface: Interface, seen: Observer, tip: np.ndarray) -> float:
        """Return the share of the workspace that a tip (3,), m, uses: 1 on the cylinder's surface."""
        x, y, z = tip - seen.believed[0]
        bottom = interface.goal.reached_m[2] - BELOW
        return max(np.hypot(x, y) / self.reach, abs(2 * z - ABOVE - bottom) / (ABOVE - bottom))
