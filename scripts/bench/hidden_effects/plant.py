"""The hidden plant: rigid arm, drives, friction and sensors integrated by equations and a scheme of its own.

Nothing of the project's effects or simulator is used. MuJoCo gives only M(q), the bias forces and the kinematics. Each
tick of h = 0.2 ms evaluates them at the half step (position Verlet: second order in h for smooth forces), advances

    link:   (M + diag) dv = h (tau_gear + tau_link - bias)
    motor:  Jm dw = h (tau_motor - F - tau_gear)                     where the transmission is flexible
    gear:   tau_gear = K dead(theta - q) + D (w - v) in contact      (two masses, dead zone)
    LuGre:  z' = v - |v| z s0 / g(v),  F = s0 z + s1 z' + fv v       (Canudas de Wit et al. 1995)
    Bouc-Wen (n = 2): s' = (k/T) v (1 - s^2 (1 + sgn(v s)) / 2),  F = T s

with the bristles backward-Euler and linearised into the mass matrix, which keeps stiction stable on a wrist of
0.001 kg m2. Rows (recordings) are vectorised: every joint array is (nrow, 7).
"""

from __future__ import annotations

import mujoco
import numpy as np
from hidden import Hide, joint_parameters, rigid_body
from mujoco.batch import Batch

BREAK_AWAY = 2.0e-5  # rad: bristle deflection at which sliding starts
BRISTLE_TIME = 5.0e-4  # s: s1 / s0
VEL = mujoco.mjtStage.mjSTAGE_VEL.value


class Plant:
    """Rows of arms, each with its own hidden effects.

    Attributes:
        q, v: (nrow, 7) link angle and speed; theta, w: motor side of the gear (equal to q, v where it is rigid).
        gear: (nrow, 7) N m, what the gear hands to the link, mean over the last tick.
    """

    def __init__(self, rows: list[tuple[Hide, ...]], q0: np.ndarray, h: float = 2.0e-4):
        self.h, self.p, self.n = h, joint_parameters(rows), len(rows)
        models = [rigid_body(hidden) for hidden in rows]
        self.batch = Batch(models[0], len(rows), nthread=1)
        self.batch.set_models(models)
        self.dense = models[0].mapM2D
        self.qpos, self.qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self.mass, self.bias = self.batch.bind("M"), self.batch.bind("qfrc_bias")
        p = self.p
        self.flex = p["motor_inertia"] > 0.0
        self.q, self.theta = q0.copy(), q0.copy()
        self.v, self.w, self.a, self.aw = (np.zeros_like(q0) for _ in range(4))
        self.z, self.s, self.lagged = np.zeros_like(q0), np.zeros_like(q0), np.zeros_like(q0)
        self.gear, self.load = np.zeros_like(q0), np.zeros_like(q0)
        self.t = 0.0
        self.level = np.maximum(p["fc"] + p["fs"] + p["warm"] + p["bump"], np.where(p["mu"] > 0.0, 1.0, 0.0))
        self.has = {k: bool((v != 0.0).any()) for k, v in p.items()} | {
            "friction": bool((self.level > 0.0).any()),
            "flex": bool(self.flex.any()),
            "limit": bool(np.isfinite(p["limit"]).any()),
        }
        self.s0 = self.level / BREAK_AWAY
        lag = np.where(p["lag"] > 0.0, p["lag"], h * 1e-3)
        self.lag_share = -np.expm1(-h / lag)  # of the way to a held command that a tick goes
        self.lag_mean = 1.0 - self.lag_share * lag / h  # and the mean over the tick of that share
        if self.has["sway"]:
            self.arms = (self.batch.bind("xaxis"), self.batch.bind("xanchor"), self.batch.bind("subtree_com"))
            self.below = np.stack([m.body_subtreemass[1:] for m in models])  # (nrow, 7) kg

    def motor_side(self) -> tuple[np.ndarray, np.ndarray]:
        """Return angle and speed (nrow, 7) that an ideal encoder on the motor would read."""
        return np.where(self.flex, self.theta, self.q), np.where(self.flex, self.w, self.v)

    def settle_load(self, tau: np.ndarray) -> None:
        """Start with the drives already giving `tau` (nrow, 7) and the flexible gears wound up by it."""
        self.lagged[:], self.gear[:], self.load[:] = tau, tau, tau
        wind = tau / self.p["stiffness"] + np.sign(tau) * self.p["play"] / 2.0
        self.theta = np.where(self.flex, self.q + wind, self.q)

    def tick(self, u: np.ndarray) -> None:
        """Advance every row by h under the torques `u` (nrow, 7) that reach the drives."""
        h, p, has, flex = self.h, self.p, self.has, self.flex
        # ..h: at the half step; ..p: speed extrapolated to the end of the step; t..: motor side
        qh = self.q + 0.5 * h * self.v
        vh, vp = self.v + 0.5 * h * self.a, self.v + h * self.a
        self.qpos[:], self.qvel[:] = qh, vh
        self.batch.forward(stage=VEL)
        matrix = self.mass[:, self.dense].reshape(self.n, 7, 7)
        th, wh, wp = qh, vh, vp
        if has["flex"]:
            th = np.where(flex, self.theta + 0.5 * h * self.w, qh)
            wh = np.where(flex, self.w + 0.5 * h * self.aw, vh)
            wp = np.where(flex, self.w + h * self.aw, vp)
        motor = self._motor(u, th)
        drag, slope = self._friction(th, wh, wp)
        push = -self.bias + self._link(qh)
        diag = p["rotor"] + slope
        drive = motor - drag
        if has["flex"]:
            gear, contact = self._gear(th - qh, wh - vh)
            diag, drive = np.where(flex, 0.5 * h * contact, diag), np.where(flex, gear, drive)
        matrix[:, range(7), range(7)] += diag
        # the linearised terms act on (a - last a): they were evaluated at the speed extrapolated with the last a
        extra = np.where(flex, 0.5 * h * contact, slope) if has["flex"] else slope
        a = np.linalg.solve(matrix, (push + drive + extra * self.a)[..., None])[..., 0]
        if has["flex"]:
            give = gear - 0.5 * h * contact * (a - self.a)
            total = p["motor_inertia"] + slope + 0.5 * h * contact
            aw = (motor - drag - give + (slope + 0.5 * h * contact) * self.aw) / np.where(flex, total, 1.0e9)
            self.gear = np.where(flex, give, motor - drag - slope * (a - self.a) - p["rotor"] * a)
        else:
            self.gear = motor - drag - slope * (a - self.a) - p["rotor"] * a
        if has["friction"]:
            speed = self.v + h * a
            if has["flex"]:
                speed = np.where(flex, self.w + h * aw, speed)
            self.z = self._bristle(speed, self.grip)[0]
            self.load += 0.1 * (np.abs(self.gear) - self.load)
        if has["flex"]:
            w1 = self.w + h * aw
            self.theta = self.theta + 0.5 * h * (self.w + w1)
            self.w, self.aw = w1, aw
        v1 = self.v + h * a
        self.q = qh + 0.5 * h * v1
        self.v, self.a = v1, a
        self.t += h

    def _motor(self, u: np.ndarray, th: np.ndarray) -> np.ndarray:
        """Return the torque at the rotor: lag, gain, bias, saturation, cogging."""
        p = self.p
        if self.has["lag"]:
            way = u - self.lagged
            u = self.lagged + self.lag_mean * way
            self.lagged += self.lag_share * way
        tau = p["gain"] * u + p["bias"]
        if self.has["limit"]:
            tau = np.clip(tau, -p["limit"], p["limit"])
        if self.has["cog_amp"]:
            tau = tau + p["cog_amp"] * np.sin(p["cog_n"] * th + p["cog_phase"])
        return tau

    def _friction(self, th: np.ndarray, wh: np.ndarray, wp: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the friction torque at the extrapolated speed, and h dF/dv there (kg m2)."""
        h, p = self.h, self.p
        force, slope = p["fv"] * wh, 0.5 * h * p["fv"]
        if self.has["hyst"]:
            rate = p["hyst_k"] / np.where(p["hyst"] > 0.0, p["hyst"], 1.0)
            self.s = self.s + h * rate * wh * (1.0 - 0.5 * self.s**2 * (1.0 + np.sign(wh * self.s)))
            force = force + p["hyst"] * self.s
        if self.has["friction"]:
            grip = p["fc"] + p["mu"] * self.load
            if self.has["fs"]:
                grip = grip + p["fs"] * np.exp(-((wp / p["vs"]) ** 2))
            if self.has["warm"]:
                grip = grip + p["warm"] * np.exp(-max(self.t, 0.0) / p["warm_tau"])
            if self.has["bump"]:
                grip = grip + p["bump"] * np.exp(-(((th - p["bump_at"]) / p["bump_width"]) ** 2))
            self.grip = np.maximum(grip, 1e-9)
            z, dz = self._bristle(wp, self.grip)
            force = force + self.s0 * (z + BRISTLE_TIME * (z - self.z) / h)
            slope = slope + h * self.s0 * (1.0 + BRISTLE_TIME / h) * dz
        return force, slope

    def _bristle(self, v: np.ndarray, grip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the backward-Euler bristle deflection at speed v, and its derivative by v."""
        k = self.h * self.s0 / grip
        below = 1.0 + np.abs(v) * k
        z = (self.z + self.h * v) / below
        return z, np.maximum(self.h - z * np.sign(v) * k, 0.0) / below

    def _gear(self, wind: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the torque through a gear wound up by `wind`, and its damping where the teeth touch."""
        p = self.p
        stretch = wind - np.clip(wind, -0.5 * p["play"], 0.5 * p["play"])
        touch = (stretch != 0.0) | (p["play"] == 0.0)
        damping = np.where(touch, p["stiffness"] * p["relaxation"], 0.0)
        tau = p["stiffness"] * stretch + damping * rate
        pulls = (p["play"] > 0.0) & (tau * stretch < 0.0)  # teeth push, never pull
        return np.where(pulls, 0.0, tau), np.where(pulls, 0.0, damping)

    def _link(self, qh: np.ndarray) -> np.ndarray:
        """Return the torque on the links from outside the drives: cable spring, vibration, a swaying base."""
        p, t = self.p, max(self.t + 0.5 * self.h, 0.0)
        tau = -p["spring"] * (qh - p["spring_ref"])
        if self.has["vib"]:
            burst = np.maximum(np.sin(2.0 * np.pi * 0.6 * t), 0.0)
            tau = tau + p["vib"] * burst * np.sin(2.0 * np.pi * p["vib_hz"] * t)
        if self.has["sway"]:
            axis, anchor, com = self.arms
            angle = p["sway"] * np.sin(2.0 * np.pi * p["sway_hz"] * t)
            change = 9.81 * np.stack([np.sin(angle), np.zeros(self.n), 1.0 - np.cos(angle)], axis=1)  # (nrow, 3)
            force = self.below[..., None] * change[:, None, :]
            tau = tau + (axis * np.cross(com[:, 1:] - anchor, force)).sum(axis=2)
        return tau
