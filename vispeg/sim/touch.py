"""Estimate contact of a recorded tool, its force and the motion of the tip, from wrist wrench and joint angles.

The wrench between flange and tool also includes the tool's weight and inertial forces. Newton's and Euler's laws for
the declared tool along the measured motion give the contact wrench: `F_c = m (a - g) - F` and `T_c = I alpha + w x I w
+ r x m (a - g) - T`, about the flange's origin. F and T are the force and torque of the flange on the tool, and r is
the tool's centre of mass.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vispeg.control.laws import rotated
from vispeg.recordings.cell import WrenchSensor, canonical, wrench_noise
from vispeg.recordings.differentiate import bridged, episodes, smooth
from vispeg.recordings.recording import Recording
from vispeg.recordings.regimes import FREE, Thresholds, regimes
from vispeg.robots.declared import carried
from vispeg.robots.model import RobotModel
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import compiled, nominal_of

MOTION_HZ = 30.0  # bandwidth of the motion from which accelerations are computed
STILL = 0.5  # s at the start of an episode without contact, from which the sensor's zero is estimated
NOISES = 6.0  # least contact force that counts as a touch, in standard deviations of a force component
ROWS = 4096  # samples per block of kinematics


@dataclass(frozen=True)
class Touch:
    """Contact along a recording; in base axes unless stated otherwise.

    Attributes:
        wrench: (n, 6) N, N m: wrench of the flange on the tool, flange axes and origin; as measured, with the sensor's
            zero offset.
        contact: (n, 6) N, N m: wrench of the surroundings on the tool, torque about the flange's origin.
        flange: (n, 7) pose of the flange in the base frame, m and w x y z.
        tip: (n, 3) m, position of the tip relative to the nominal goal (z out of it); relative to the base if there is
            no goal.
        velocity: (n, 3) velocity of the tip, m/s.
        regime: (n,) indices into `vispeg.recordings.regimes.REGIMES`.
        threshold: contact force that counts as a touch, N.
    """

    wrench: np.ndarray
    contact: np.ndarray
    flange: np.ndarray
    tip: np.ndarray
    velocity: np.ndarray
    regime: np.ndarray
    threshold: float

    @property
    def touching(self) -> np.ndarray:
        """Whether the tool touches something, (n,) bool."""
        return self.regime != FREE

    @property
    def force(self) -> np.ndarray:
        """Magnitude of the contact force, (n,) N."""
        return np.linalg.norm(self.contact[:, :3], axis=1)


def touch(rec: Recording, robot: RobotModel, thresholds: Thresholds | None = None) -> Touch | None:
    """Compute the contact of the recorded tool; None without a recorded wrench (`ft`).

    The sensor's zero offset, constant in flange axes, is estimated in the first half second of each episode, which must
    be free of contact.

    Args:
        rec: the recording.
        robot: the nominal cell (a Scene), or the arm with its declared tool; then there is no goal, and the tip is the
            flange.
        thresholds: thresholds of the regimes; that of the force is raised if the noise requires it.
    """
    if rec.ft is None:
        return None
    scene = robot if isinstance(robot, Scene) and robot.goal else None
    arm = robot.nominal if isinstance(robot, Scene) else robot
    q, dq, ddq = smooth(rec.time, bridged(rec.time, rec.q, rec.episode), MOTION_HZ, rec.episode)
    pos, quat, twist, rate = _flange(arm, *(np.nan_to_num(v) for v in (q, dq, ddq)))
    axes = np.stack([rotated(quat, np.tile(e, (len(quat), 1))) for e in np.eye(3)], axis=2)  # (n, 3, 3) flange to base
    wrench = canonical(rec.ft, rec.wrench or WrenchSensor(), axes)
    weightless = rec.wrench is not None and rec.wrench.tared == "weight"  # the sensor has subtracted the tool's weight
    gravity = np.zeros(3) if weightless else compiled(arm).opt.gravity
    needed = _needed(tool_of(arm), axes, twist[:, 3:], rate, gravity)
    residual = needed - np.concatenate([rotated(quat, wrench[:, :3]), rotated(quat, wrench[:, 3:])], axis=1)
    residual[np.isnan(rec.q).any(axis=1)] = np.nan  # the motion is only interpolated there
    contact = _zeroed(rec, bridged(rec.time, residual, rec.episode), axes)  # a missing reading does not end a touch
    lever = np.array([0.0, 0.0, scene.tip]) if scene else np.zeros(3)
    tip = pos + axes @ lever
    velocity = twist[:, :3] + np.cross(twist[:, 3:], axes @ lever)
    depth = None
    if scene is not None:
        tip, velocity = tip - scene.target, velocity.copy()
        # m below the goal's plane; -1 where the tip is not over the goal
        depth = np.where(np.hypot(tip[:, 0], tip[:, 1]) < scene.config.apothem, -tip[:, 2], -1.0)
    noise = wrench_noise(rec.noise)
    th = thresholds or Thresholds()
    least = max(th.touch, NOISES * float(noise[0]) if noise is not None else 0.0)
    th = replace(th, touch=least)
    force, regime = np.linalg.norm(contact[:, :3], axis=1), np.zeros(len(tip), int)
    normal = _normal(contact[:, :3])
    tangential = velocity - np.sum(velocity * normal, axis=1, keepdims=True) * normal
    for rows in episodes(rec.time, rec.episode):
        depths = None if depth is None else depth[rows]
        speeds = np.linalg.norm(tangential[rows], axis=1), np.linalg.norm(velocity[rows], axis=1)
        regime[rows] = regimes(rec.time[rows], force[rows], *speeds, depths, th)
    return Touch(wrench, contact, np.concatenate([pos, quat], axis=1), tip, velocity, regime, least)


def _normal(force: np.ndarray) -> np.ndarray:
    """Return the base axis (n, 3) nearest to the contact force as the surface normal: friction tilts the force."""
    out = np.zeros_like(force)
    out[np.arange(len(force)), np.nan_to_num(np.abs(force)).argmax(axis=1)] = 1.0
    return out


def _flange(arm: RobotModel, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> tuple[np.ndarray, ...]:
    """Compute position, quaternion, twist (n, 6) and its rate (n, 6) of the flange; Jdot by a central difference."""
    parts = []
    for start in range(0, len(q), ROWS):
        block = slice(start, start + ROWS)
        nominal, h = nominal_of(arm, len(q[block])), 1e-5  # h: s, step of the difference
        before = nominal.operational(q[block] - h * dq[block])[1]
        after = nominal.operational(q[block] + h * dq[block])[1]
        _, jac, pos, quat, _ = nominal.operational(q[block])
        rate = np.einsum("nij,nj->ni", jac, ddq[block]) + np.einsum("nij,nj->ni", (after - before) / (2 * h), dq[block])
        parts.append((pos, quat, np.einsum("nij,nj->ni", jac, dq[block]), rate))
    return tuple(np.concatenate(p) for p in zip(*parts, strict=True))


def tool_of(arm: RobotModel) -> tuple[float, np.ndarray, np.ndarray]:
    """Return the tool's mass, kg, centre (3,), m, and inertia (3,), kg m^2, in flange axes; 0 without a tool."""
    model = compiled(arm)
    if not any(model.body(b).name == "tool" for b in range(model.nbody)):
        return 0.0, np.zeros(3), np.zeros(3)
    tool = carried(model)
    return tool["mass_kg"], np.array(tool["com_m"]), np.array(tool["inertia_kgm2"])


def _needed(tool: tuple, axes: np.ndarray, omega: np.ndarray, rate: np.ndarray, gravity: np.ndarray) -> np.ndarray:
    """Compute the wrench (n, 6) on the tool, base axes, about the flange's origin, for its motion and weight."""
    mass, com, inertia = tool
    r = axes @ com
    alpha = rate[:, 3:]
    acc = rate[:, :3] + np.cross(alpha, r) + np.cross(omega, np.cross(omega, r))
    force = mass * (acc - gravity)
    turn = axes @ (inertia[:, None] * np.swapaxes(axes, 1, 2))
    spin = np.einsum("nij,nj->ni", turn, alpha) + np.cross(omega, np.einsum("nij,nj->ni", turn, omega))
    return np.concatenate([force, spin + np.cross(r, force)], axis=1)


def _zeroed(rec: Recording, residual: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Subtract the sensor's zero offset, constant in flange axes, from `residual` (n, 6) in base axes."""
    halves = [np.einsum("nji,nj->ni", axes, v) for v in (residual[:, :3], residual[:, 3:])]
    inner = np.concatenate(halves, axis=1)
    for rows in episodes(rec.time, rec.episode):
        start = rows[rec.time[rows] <= rec.time[rows[0]] + STILL]
        inner[rows] -= np.nanmedian(inner[start], axis=0)
    return np.concatenate([np.einsum("nij,nj->ni", axes, v) for v in (inner[:, :3], inner[:, 3:])], axis=1)
