"""A joint's loop as a MuJoCo actuator, and the step that a simulated joint makes with it.

torque = k (K u - q) - d dq: `gainprm` = (K k, 0, 0), `biasprm` = (0, -k, -d), no activation (`dyntype` none), and the
delay as MuJoCo's own history of commands. At a joint that turns the inertia J alone the closed loop is H(s) of
`vispeg.measure.steps` with k = J wn^2, d = 2 J z wn (MuJoCo 4.0 manual, actuator/general). Friction is the joint's.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from vispeg.measure import steps as steps_of
from vispeg.measure.arm import LEAST, Loop
from vispeg.measure.steps import Servo, Step
from vispeg.measure.trace import Trace

TIMESTEP = 1e-3  # s, that the history is written for
WINDOW = 1.5  # s of a held-out step that are compared


def alone(servo: Servo, inertia_kgm2: float, viscous: float = 0.0) -> tuple[Loop, np.ndarray]:
    """Give the loop of a joint that turns this inertia alone, with viscous friction (N m s/rad) of its own.

    Returns:
        The loop, and (4, 4) the slopes of its `numbers` over those of the servo.
    """
    wn, whole = servo.natural_frequency, 2.0 * inertia_kgm2 * servo.damping_ratio * servo.natural_frequency
    damping = max(whole - viscous, LEAST * whole)
    slopes = np.diag([1.0, 2.0, whole / damping, 1.0])
    slopes[2, 1] = whole / damping
    return Loop(servo.gain, inertia_kgm2 * wn**2, damping, servo.delay), slopes


def parameters(loop: Loop) -> dict[str, list[float]]:
    """gainprm, biasprm and dynprm (3,) each."""
    gain = [loop.gain * loop.stiffness, 0.0, 0.0]
    return {"gainprm": gain, "biasprm": [0.0, -loop.stiffness, -loop.damping], "dynprm": [1.0, 0.0, 0.0]}


def element(loop: Loop, joint: str) -> str:
    """Give the `<general>` element."""
    words = {key: " ".join(f"{x:.8g}" for x in value) for key, value in parameters(loop).items()}
    late = ""
    if loop.delay >= TIMESTEP:
        late = f' delay="{loop.delay:.6g}" nsample="{int(np.ceil(loop.delay / TIMESTEP)) + 1}"'
    return (
        f'<general name="{joint}" joint="{joint}" dyntype="none" dynprm="{words["dynprm"]}" gaintype="fixed" '
        f'gainprm="{words["gainprm"]}" biastype="affine" biasprm="{words["biasprm"]}"{late}/>'
    )


def text(servo: Servo, loop: Loop, joint: str, about: Sequence[str]) -> str:
    """Give an MJCF file with the actuator alone, to be included; sentences `about` it stand in a comment."""
    said = "".join(f"\n       {line}" for line in about)
    comment = (
        f"  <!-- {joint} answers with K {servo.gain:.4g}, natural frequency {servo.natural_frequency:.4g} rad/s, "
        f"damping ratio {servo.damping_ratio:.3g}, delay {1e3 * servo.delay:.3g} ms.{said}\n       For a timestep of "
        f"{TIMESTEP:g} s or more. -->\n"
    )
    return f"<mujoco>\n{comment}  <actuator>\n    {element(loop, joint)}\n  </actuator>\n</mujoco>\n"


def simulated(servo: Servo, command: np.ndarray, period: float, band: float = 0.0, wound: float = 0.0) -> np.ndarray:
    """Angles (n,) rad of a joint of 1 kg m^2 with this servo, from rest; command (n,) rad, each held for `period` s.

    Args:
        servo: of the joint.
        command: from row to row.
        period: s.
        band: rad, dry friction over stiffness.
        wound: rad within the band, by which the servo pulls at the start.
    """
    stiffness = servo.natural_frequency**2
    dry = f'frictionloss="{band * stiffness:.8g}" solreffriction="0.001 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"'
    hinge = (
        f'<mujoco><option timestep="{TIMESTEP}" gravity="0 0 0" integrator="implicitfast"/><worldbody><body>'
        f'<joint name="j" armature="1" {dry}/><geom size="0.1" mass="1e-6"/></body></worldbody>'
        f"<actuator>{element(alone(servo, 1.0)[0], 'j')}</actuator></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(hinge)
    model.opt.timestep = period / max(1, round(period / TIMESTEP))
    data, out = mujoco.MjData(model), np.empty(len(command))
    data.qfrc_applied[0] = wound * stiffness
    shift = command[0]
    for k, u in enumerate(command - shift):
        out[k] = data.qpos[0]
        data.ctrl[0] = u
        for _ in range(max(1, round(period / TIMESTEP))):
            mujoco.mj_step(model, data)
    return out + servo.gain * shift


def step_error(servo: Servo, band: float, traces: Sequence[Trace], steps: Sequence[Step]) -> list[float]:
    """RMS between each step as measured and as simulated with `servo` and friction, as a share of the step's size."""
    by_name = {t.name: t for t in traces}
    wound = steps_of.wound(servo, band, traces, steps)
    out = []
    for step, pull in zip(steps, wound, strict=True):
        trace = by_name[step.trace]
        first = int(np.searchsorted(trace.time, step.start))
        last = int(np.searchsorted(trace.time, step.start + WINDOW))
        later = [s.start for s in steps if s.trace == step.trace and s.start > step.start]
        last = min(last, int(np.searchsorted(trace.time, min(later)))) if later else last
        before = steps_of.before(trace, first)
        command = trace.q_cmd[first - 1 : last] - trace.q_cmd[first - 1]
        model = simulated(servo, command, trace.period, band, pull)[1:]
        out.append(float(np.sqrt(np.mean((trace.q[first:last] - before - model) ** 2)) / abs(step.size)))
    return out
