"""The signature of an effect in time: the difference between noiseless closed-loop motions with and without it.

It is drawn to explain an effect. (A diagnosis uses the signatures of `diagnosis.evidence.signatures`, the same
difference in the residual.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.seeds import stream
from vispeg.identify.excitation import motion
from vispeg.identify.record import centre_of, controller
from vispeg.robots.model import load
from vispeg.sim.rollout import simulate
from vispeg.sim.segments.segment import Segment
from vispeg.worlds.words import place
from vispeg.worlds.world import World

RATE, SECONDS = 500.0, 5.0  # Hz, s
JOINT, LINK = "joint4", "link4"  # default place of an effect


@dataclass(frozen=True)
class Signature:
    """An effect at a typical size under joint position control, or in a servo's own loop if it acts only there.

    Attributes:
        placed: the effect, its place and values.
        joint: the joint shown: the effect's own, else the one with the largest deviation times stiffness.
        motion: name of the commanded motion.
        time: (n,) s.
        deviation: (n,) rad, measured angle with the effect minus without.
        torque: (n,) N m, motor torque with the effect minus without.
        angle, speed: (n,) rad, rad/s, of the joint without the effect: what the torque may depend on.
    """

    placed: EffectInstance
    joint: str
    motion: str
    time: np.ndarray
    deviation: np.ndarray
    torque: np.ndarray
    angle: np.ndarray
    speed: np.ndarray


def signature(name: str, where: str | None = None, *, robot: str = "iiwa14") -> Signature:
    """Drive the robot with and without an effect: slow and fast strokes for joint effects, else a Fourier motion.

    `where` is by default a joint or link in the middle of the arm, if the effect has such a place, else its first one.
    """
    kind, model = effect(name), load(robot)
    targets = kind.targets(model)
    usual = next((t for t in (JOINT, LINK) if t in targets), targets[0])
    spot = usual if where is None else place(kind, where, model)
    placed = EffectInstance.of(name, spot, **{k: p.start for k, p in kind.params.items()})
    move = "triangle" if kind.family == "joint" else "fourier"
    m = motion(move, model, RATE, SECONDS, stream(0, "signature"))
    # an effect in a servo's loop alone lacks the channel `angle`
    mode = "position" if "angle" in kind.channels() else "servo"
    control = controller(model, mode, RATE, centre_of(model))
    command = {"q_cmd": m.q_cmd, "dq_cmd": m.dq_cmd}
    rows = np.arange(len(m.time))
    segment = Segment(control, 1.0 / RATE, command, q=m.q_cmd, dq=m.dq_cmd, q_raw=m.q_cmd, time=m.time, rows=rows)
    r = simulate(model, [World(robot), World(robot, None, (placed,))], [segment], nthread=1)[0]
    stiffness = 1.0 if control.kp is None else control.kp
    size = np.sqrt(np.nanmean(((r.q[1] - r.q[0]) * stiffness) ** 2, axis=0))
    j = model.joints.index(spot) if spot in model.joints else int(np.argmax(size))
    q, tau = r.q[:, :, j], r.tau_motor[:, :, j]
    return Signature(placed, model.joints[j], move, m.time, q[1] - q[0], tau[1] - tau[0], q[0], r.dq[0, :, j])
