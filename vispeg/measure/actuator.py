"""A joint's position loop as a MuJoCo actuator, and the simulated step response of a joint with it.

torque = k (K u - q) - d dq: `gainprm` = (K k, 0, 0), `biasprm` = (0, -k, -d), no activation (`dyntype` none), and the
delay as MuJoCo's own history of commands. For a joint that turns the inertia J alone the closed loop is H(s) of
`vispeg.measure.steps` with k = J wn^2, d = 2 J z wn (MuJoCo 4.0 manual, actuator/general). Friction is a property of
the joint, not of the actuator.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from vispeg.measure import steps as steps_of
from vispeg.measure.arm import LEAST, Loop
from vispeg.measure.steps import Servo, Step

TIMESTEP = 1e-3  # s, smallest timestep for which the actuator's command history is long enough
WINDOW = 1.5  # s of a step that are compared with the simulation


def alone(servo: Servo, inertia_kgm2: float, viscous: float = 0.0) -> tuple[Loop, np.ndarray]:
    """Return the loop with which a joint that turns only its own inertia answers like a servo.

    Args:
        servo: the second-order servo to match.
        inertia_kgm2: inertia that the joint turns.
        viscous: N m s/rad, viscous friction in the joint, which provides a part of the damping.

    Returns:
        The loop, and the derivatives (4, 4) of `Loop.numbers` with respect to `arm.numbers(servo)`.
    """
    wn, whole = servo.natural_frequency, 2.0 * inertia_kgm2 * servo.damping_ratio * servo.natural_frequency
    damping = max(whole - viscous, LEAST * whole)
    slopes = np.diag([1.0, 2.0, whole / damping, 1.0])
    slopes[2, 1] = whole / damping
    return Loop(servo.gain, inertia_kgm2 * wn**2, damping, servo.delay), slopes


def parameters(loop: Loop) -> dict[str, list[float]]:
    """Return MuJoCo's gainprm, biasprm and dynprm (3,) of the loop, by name."""
    gain = [loop.gain * loop.stiffness, 0.0, 0.0]
    return {"gainprm": gain, "biasprm": [0.0, -loop.stiffness, -loop.damping], "dynprm": [1.0, 0.0, 0.0]}


def element(loop: Loop, joint: str) -> str:
    """Return the loop as an MJCF `<general>` element."""
    words = {key: " ".join(f"{x:.8g}" for x in value) for key, value in parameters(loop).items()}
    late = ""
    if loop.delay >= TIMESTEP:
        late = f' delay="{loop.delay:.6g}" nsample="{int(np.ceil(loop.delay / TIMESTEP)) + 1}"'
    return (
        f'<general name="{joint}" joint="{joint}" dyntype="none" dynprm="{words["dynprm"]}" gaintype="fixed" '
        f'gainprm="{words["gainprm"]}" biastype="affine" biasprm="{words["biasprm"]}"{late}/>'
    )


def text(servo: Servo, loop: Loop, joint: str, about: Sequence[str]) -> str:
    """Return the text of an MJCF file with only the actuator, for `<include>`; sentences `about` become a comment."""
    said = "".join(f"\n       {line}" for line in about)
    comment = (
        f"  <!-- {joint} answers with K {servo.gain:.4g}, natural frequency {servo.natural_frequency:.4g} rad/s, "
        f"damping ratio {servo.damping_ratio:.3g}, delay {1e3 * servo.delay:.3g} ms.{said}\n       For a timestep of "
        f"{TIMESTEP:g} s or more. -->\n"
    )
    return f"<mujoco>\n{comment}  <actuator>\n    {element(loop, joint)}\n  </actuator>\n</mujoco>\n"


def simulated(servo: Servo, command: np.ndarray, period: float, band: float = 0.0, wound: float = 0.0) -> np.ndarray:
    """Simulate a joint of 1 kg m^2 with this servo, which starts at rest, and return its angles (n,) rad.

    Args:
        servo: of the joint.
        command: (n,) rad, each held for `period`.
        period: s.
        band: rad, dry friction divided by stiffness.
        wound: rad, within +-band: torque divided by stiffness with which the servo already pulls at the start.
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


def step_error(servo: Servo, band: float, steps: Sequence[Step]) -> list[float]:
    """Return the RMS error of each step simulated with `servo` and dry friction, as a share of the step's size.

    Args:
        servo: of the joint.
        band: rad, dry friction divided by stiffness.
        steps: to compare.
    """
    wound = steps_of.wound(servo, band, steps)
    out = []
    for step, pull in zip(steps, wound, strict=True):
        trace = step.trace
        first = int(np.searchsorted(trace.time, step.start))
        last = int(np.searchsorted(trace.time, step.start + WINDOW))
        later = [s.start for s in steps if s.trace is trace and s.start > step.start]
        last = min(last, int(np.searchsorted(trace.time, min(later)))) if later else last
        rest, swing = steps_of.rested(trace, first, last, servo)
        command = trace.q_cmd[first - 1 : last] - trace.q_cmd[first - 1]
        model = simulated(servo, command, trace.period, band, pull)[1:]
        out.append(float(np.sqrt(np.mean((trace.q[first:last] - rest - swing - model) ** 2)) / abs(step.size)))
    return out
