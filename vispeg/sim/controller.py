"""The recorded controller, for all rows of a batch: from encoder readings to commanded torques."""

from __future__ import annotations

import numpy as np

from vispeg.control.laws import hold_pose, position
from vispeg.robots.model import RobotModel
from vispeg.sim.nominal import Nominal
from vispeg.sim.segments.along import gravity, gravity_slope, measured_gravity, once
from vispeg.sim.segments.rows import ByTick, Rows


class Controller:
    """The controller of a recording: joint impedance, operational space, recorded torques or goals of servos.

    The laws are those of docs/formats.md.

    Args:
        robot: the nominal robot, as the controller does not know the effects.
        rows: segments of the rollout.
        nominal: evaluator of the nominal quantities, one row per simulation.
        reference: measured angles by tick, (nsim, nj) rad.
        along: linearise nominal gravity about the measured motion (position control only).
    """

    def __init__(self, robot: RobotModel, rows: Rows, nominal: Nominal, reference: ByTick, along: bool):
        nj = len(robot.joints)
        self.nominal, self.reference = nominal, reference
        self.mode = rows.segments[0].control.mode
        self.null = rows.segments[0].control.nullspace
        self.compensation = rows.constant(lambda s: float(s.control.gravity_compensation == "model"), 1)
        self.compensated, self.all = bool(self.compensation.any()), bool(self.compensation.all())
        self.along = along and self.mode == "position" and self.compensated
        if self.mode in ("position", "osc"):
            width = nj if self.mode == "position" else 6
            self.kp = rows.constant(lambda s: s.control.kp, width)
            self.kd = rows.constant(lambda s: s.control.kd, width)
        if self.mode in ("position", "servo"):
            self.q_cmd = rows.by_tick(lambda s: s.command["q_cmd"])
        if self.mode == "position":
            self.dq_cmd = rows.by_tick(lambda s: s.command.get("dq_cmd", np.zeros_like(s.q)))
        elif self.mode == "osc":
            limits = [s.control.force_limit for s in rows.segments]
            self.force_limit = None
            if any(limit is not None for limit in limits):
                self.force_limit = rows.constant(lambda s: _or_inf(s.control.force_limit), 1)[:, 0]
            self.torque_limit = None
            if any(s.control.torque_limit is not None for s in rows.segments):
                self.torque_limit = rows.constant(lambda s: _or_inf(s.control.torque_limit), nj)
            self.ee_cmd = rows.by_tick(lambda s: s.command["ee_cmd"])
        elif self.mode == "torque":
            self.tau_cmd = rows.by_tick(lambda s: s.command["tau_cmd"] + once(s, robot, measured_gravity))
        if self.along:
            self.gravity0 = rows.by_tick(lambda s: once(s, robot, gravity))
            self.gravity1 = rows.by_tick(lambda s: once(s, robot, gravity_slope))

    def command(self, k: int, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        """Return the command (nsim, nj) at tick k: torques, N m, or goals of servos, rad.

        Args:
            k: tick.
            q, dq: (nsim, nj) encoder readings, rad and rad/s.
        """
        if self.mode == "servo":
            return self.q_cmd[k]
        if self.mode == "position":
            tau = position(self.q_cmd[k], self.dq_cmd[k], q, dq, self.kp, self.kd)
            if self.compensated:
                tau += self._gravity(k, q) if self.all else self.compensation * self._gravity(k, q)
            return tau
        if self.mode == "osc":
            return self._osc(k, q, dq)
        return self.tau_cmd[k] if self.mode == "torque" else np.zeros_like(q)

    def _gravity(self, k: int, q: np.ndarray) -> np.ndarray:
        if not self.along:
            return self.nominal.gravity(q)
        return self.gravity0[k] + np.einsum("nij,nj->ni", self.gravity1[k], q - self.reference[k])

    def _osc(self, k: int, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        state, goal = self.nominal.operational(q), self.ee_cmd[k]
        pull = None if self.null is None else self.null.kp * (self.null.q - q) - self.null.kd * dq
        tau = hold_pose(state, dq, goal[:, :3], goal[:, 3:], self.kp, self.kd, pull, self.force_limit)
        tau = tau + self.compensation * state[4]
        return tau if self.torque_limit is None else np.minimum(np.maximum(tau, -self.torque_limit), self.torque_limit)


def _or_inf(limit: np.ndarray | float | None) -> np.ndarray | float:
    return np.inf if limit is None else limit
