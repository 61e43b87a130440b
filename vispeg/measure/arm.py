"""Find the stiffness and damping of a joint's position loop inside the arm, from its second-order step response.

A servo pulls with `tau = k (K u - q) - d dq`. The inertia that it turns depends on the other joints: it would be M_jj
if these stood still, but they hold only as stiffly as their own loops. So the loop is found by indirect inference
(Gourieroux, Monfort and Renault, J. Applied Econometrics 8, 1993): choose the loop with which the linear arm,
`M x'' + D x' + (G + diag(k)) x = k_j K u`, gives the same second-order servo as the recordings if both are fitted by
the same estimator. G is the slope of gravity. `vispeg.measure.joint` then refines the loop by least squares, by
simulating this arm with dry friction through all commanded steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.linalg import expm

from vispeg.effects.common.servo_loop import FAST
from vispeg.measure.steps import Servo
from vispeg.recordings.recording import Recording
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import compiled
from vispeg.sim.recorded import with_robot
from vispeg.sim.servo import reference_inertia

TURN = 1e-4  # rad, step of the finite difference for gravity's slope
STEP = 1e-2  # relative step of the finite differences of the estimator, whose fits are accurate to 1e-5
LEAST = 0.01  # least share of the total damping that is the loop's, even if viscous friction seems to explain all
ROUNDS = 4  # rounds of Newton's method; started from M_jj, three reach 1e-6


@dataclass(frozen=True)
class Loop:
    """A servo's loop at a joint: gain, stiffness (N m/rad), damping (N m s/rad), delay (s)."""

    gain: float
    stiffness: float
    damping: float
    delay: float

    @property
    def numbers(self) -> np.ndarray:
        """(4,): gain, logarithms of stiffness and damping, delay; inverse of `of`."""
        return np.array([self.gain, np.log(self.stiffness), np.log(self.damping), self.delay])

    @classmethod
    def of(cls, numbers: np.ndarray) -> Loop:
        """Return the loop with these `numbers` (4,)."""
        gain, stiffness, damping, delay = (float(x) for x in numbers)
        return cls(gain, float(np.exp(stiffness)), float(np.exp(damping)), delay)


@dataclass(frozen=True)
class Arm:
    """The arm linearized about one posture.

    Attributes:
        joint: index of the joint that is measured.
        inertia: (nj, nj) kg m^2.
        slope: (nj, nj) N m/rad, derivative of the gravity torque with respect to the angles; 0 if it is compensated.
        stiffness, damping: (nj,) N m/rad and N m s/rad of the joints' loops; the entry of `joint` is not used.
        passive: (nj,) N m s/rad, the joints' own damping.
        reference: kg m^2, the inertia to which the natural frequency and damping ratio of the effect `servo` refer.
        late: s, mean delay of the loops' torques: half a period of a controller that holds its torque.
    """

    joint: int
    inertia: np.ndarray
    slope: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    passive: np.ndarray
    reference: float
    late: float = 0.0

    @property
    def held(self) -> float:
        """The inertia (kg m^2) that the joint turns if the others stand still."""
        return float(self.inertia[self.joint, self.joint])

    def with_friction(self, viscous: float) -> Arm:
        """Return a copy with viscous friction in the joint, N m s/rad."""
        return replace(self, passive=self.passive + viscous * np.eye(len(self.passive))[self.joint])

    def modes(self, loop: Loop) -> tuple[np.ndarray, np.ndarray, float]:
        """Return the modes of the joint's answer to a unit step: poles (2 nj,) 1/s, amplitudes (2 nj,), end value."""
        n, j = len(self.stiffness), self.joint
        inertia, spring, drag = self._matrices(loop)
        a = np.zeros((2 * n, 2 * n))
        a[:n, n:] = np.eye(n)
        a[n:] = -np.linalg.solve(inertia, np.hstack([spring, drag]))
        ends = np.linalg.solve(spring, loop.gain * loop.stiffness * np.eye(n)[j])
        poles, vectors = np.linalg.eig(a)
        return poles, vectors[j] * np.linalg.solve(vectors, np.concatenate([-ends, 0.0 * ends])), float(ends[j])

    def _matrices(self, loop: Loop) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return inertia, stiffness and damping (nj, nj) with all loops closed."""
        own = np.arange(len(self.stiffness)) == self.joint
        k, d = np.where(own, loop.stiffness, self.stiffness), np.where(own, loop.damping, self.damping)
        # the delay `late` to first order, so that there are still 2 nj poles
        return (
            self.inertia - self.late * np.diag(d),
            self.slope + np.diag(k),
            np.diag(d + self.passive - self.late * k),
        )

    def answer(self, t: np.ndarray, loop: Loop) -> np.ndarray:
        """Return the joint's angle (n,) at times t (n,) s after a unit step of its goal at time 0."""
        poles, shares, end = self.modes(loop)
        late = t - loop.delay
        return np.where(late > 0, end + np.real(np.exp(np.outer(np.maximum(late, 0.0), poles)) @ shares), 0.0)

    def dry(
        self, loop: Loop, friction: float, goals: np.ndarray, dt: float, wound: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Simulate the joint from rest with dry friction, without the loop's delay.

        Args:
            loop: of the joint.
            friction: dry friction, N m.
            goals: (n, ngrid) rad, mean goal in each interval, relative to the goal at rest, for n motions.
            dt: s, interval of the grid; the joint reverses at most once in an interval.
            wound: (n,) N m, torque of the loop at the start, while friction holds the joint.

        Returns:
            Angle rad and speed rad/s, (n, ngrid + 1) each.
        """
        nj, j, n = len(self.stiffness), self.joint, len(goals)
        inertia, spring, drag = self._matrices(loop)
        others = np.arange(nj) != j
        pull = np.zeros((2 * nj, 1))
        pull[nj:, 0] = np.linalg.solve(inertia, np.eye(nj)[j])
        moving = np.zeros((2 * nj, 2 * nj))
        moving[:nj, nj:] = np.eye(nj)
        moving[nj:] = -np.linalg.solve(inertia, np.hstack([spring, drag]))
        held = moving.copy()
        held[nj:] = 0.0
        held[nj:][others] = -np.linalg.solve(inertia[np.ix_(others, others)], np.hstack([spring, drag])[others])
        push = expm(np.block([[moving, pull], [np.zeros((1, 2 * nj + 1))]]) * dt)
        rest = expm(held * dt)
        # friction needed for the joint to stay at rest: the torque asked for minus `needed` times the state
        needed = np.hstack([spring, drag])[j] + inertia[j, others] @ held[nj:][others]
        x, way = np.zeros((n, 2 * nj)), np.zeros(n)
        q, v = np.zeros((2, goals.shape[1] + 1, n))
        for k in range(goals.shape[1]):
            asked = loop.gain * loop.stiffness * goals[:, k] + wound
            free = asked - x @ needed
            way = np.where(way != 0.0, way, np.sign(free) * (np.abs(free) > friction))
            still = way == 0.0
            then = x @ push[:-1, :-1].T + (asked - way * friction)[:, None] * push[:-1, -1]
            then = np.where(still[:, None], x @ rest.T, then)
            turned = ~still & (way * then[:, nj + j] < 0.0)
            before = x[turned, nj + j]
            # share of the interval after which the joint stops
            part = np.where(before * way[turned] > 0.0, before / (before - then[turned, nj + j]), 0.0)
            stop = x[turned] + part[:, None] * (then[turned] - x[turned])
            back = np.abs(asked[turned] - stop @ needed) > friction
            # for the rest of the interval friction acts in the other direction, or holds the joint; a constant torque
            # adds to the angle in proportion to the square of the time left, and to the speed in proportion to it
            left = np.repeat([(1.0 - part) ** 2, 1.0 - part], nj, axis=0).T
            flipped = then[turned] + 2.0 * (friction * way[turned])[:, None] * left * push[:-1, -1]
            held_at = then[turned].copy()
            held_at[:, j], held_at[:, nj + j] = stop[:, j], 0.0
            then[turned] = np.where(back[:, None], flipped, held_at)
            way[turned] = np.where(back, -way[turned], 0.0)
            x = then
            q[k + 1], v[k + 1] = x[:, j], x[:, nj + j]
        return q.T, v.T

    def response(self, f: np.ndarray, loop: Loop) -> np.ndarray:
        """Return the joint's frequency response (n,), complex, at f (n,) Hz."""
        poles, shares, end = self.modes(loop)
        s = 2j * np.pi * np.asarray(f)[:, None]
        return (end + (s / (s - poles)) @ shares) * np.exp(-s[:, 0] * loop.delay)

    def effect(self, loop: Loop) -> dict[str, float]:
        """Return this loop as parameters of the effect `servo`."""
        wn = float(np.sqrt(loop.stiffness / self.reference))
        return {
            "natural_frequency": wn,
            "damping_ratio": loop.damping / (2.0 * wn * self.reference),
            "gain": loop.gain,
        }


def arm_of(rec: Recording, joint: str) -> Arm:
    """Return the arm of a recording about its median posture; the other joints have the loops that it states.

    Raises:
        UserError: an unknown robot, or joints that it does not have.
    """
    rec, robot = with_robot(rec)
    law, reference = rec.control, reference_inertia(robot)
    mass, slope, passive = about(robot, np.nanmedian(rec.q, axis=0))
    late = 0.0
    if law.mode == "position" and law.kp is not None and law.kd is not None:
        stiffness, damping, late = law.kp, law.kd, 0.5 / law.rate_hz
        slope = 0.0 * slope if law.gravity_compensation == "model" else slope
    else:
        stiffness, damping = reference * FAST**2, 2.0 * reference * FAST
    j = rec.joints.index(joint)
    return Arm(j, mass, slope, stiffness, damping, passive, float(reference[j]), late)


def about(robot: RobotModel, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Linearize an arm at rest about the posture q (nj,) rad.

    Returns:
        Inertia (nj, nj) kg m^2, slope of gravity and springs (nj, nj) N m/rad, damping (nj,) N m s/rad.
    """
    model = compiled(robot)
    data = mujoco.MjData(model)
    dof = [model.joint(name).dofadr[0] for name in robot.joints]
    place = [model.joint(name).qposadr[0] for name in robot.joints]

    def at(posture: np.ndarray) -> np.ndarray:
        data.qpos[place] = posture
        mujoco.mj_forward(model, data)
        return (data.qfrc_bias - data.qfrc_passive)[dof]

    at(q)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    ways = TURN * np.eye(len(q))
    slope = np.stack([(at(q + way) - at(q - way)) / (2.0 * TURN) for way in ways], axis=1)
    return full[np.ix_(dof, dof)], slope, model.dof_damping[dof]


def inferred(servo: Servo, arm: Arm, look: Callable[[Loop], Servo]) -> tuple[Loop, np.ndarray]:
    """Return the loop with which the arm answers like `servo`.

    Args:
        servo: as fitted to the recordings.
        arm: the linear arm, with the joint's viscous friction if that is known.
        look: returns the servo that the same estimator fits to the arm with a given loop.

    Returns:
        The loop, and the derivatives (4, 4) of `Loop.numbers` with respect to `numbers` of the servo.
    """
    goal = numbers(servo)
    whole = 2.0 * arm.held * servo.damping_ratio * servo.natural_frequency
    damping = max(whole - float(arm.passive[arm.joint]), LEAST * whole)
    at = Loop(servo.gain, arm.held * servo.natural_frequency**2, damping, servo.delay).numbers
    for _ in range(ROUNDS):
        seen = numbers(look(Loop.of(at)))
        steps = np.diag([STEP, STEP, STEP, 0.1 * STEP])
        slopes = np.stack([(numbers(look(Loop.of(at + s))) - seen) / s[k] for k, s in enumerate(steps)], axis=1)
        inverse = np.linalg.pinv(slopes)
        move = inverse @ (goal - seen)
        at = at + np.clip(move, -0.7, 0.7)
        if np.abs(move).max() < 1e-6:
            break
    return Loop.of(at), inverse


def numbers(servo: Servo) -> np.ndarray:
    """Return a servo as numbers (4,): gain, logarithms of natural frequency and damping ratio, delay."""
    return np.array([servo.gain, np.log(servo.natural_frequency), np.log(servo.damping_ratio), servo.delay])
