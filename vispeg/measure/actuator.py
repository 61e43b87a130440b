"""A measured servo as a MuJoCo actuator, and the step that a simulated joint makes with it.

torque = J (K wn^2 u - wn^2 q - 2 z wn dq), with J the inertia that the joint turns: `gainprm` = (J K wn^2, 0, 0),
`biasprm` = (0, -J wn^2, -2 J z wn), no activation (`dyntype` none), and the delay as MuJoCo's own history of commands.
The closed loop then is H(s) of `vispeg.measure.steps`, gain K included (MuJoCo 4.0 manual, actuator/general).
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from vispeg.measure.steps import Servo, Step
from vispeg.measure.trace import Trace
from vispeg.robots.model import RobotModel

TIMESTEP = 1e-3  # s, that the history is written for
WINDOW = 1.5  # s of a held-out step that are compared


def inertia(robot: RobotModel, joint: str, q: np.ndarray) -> float:
    """The inertia (kg m^2) that a joint turns at posture q (nj,) rad while the others are held: M_jj."""
    model = robot.compile()
    data = mujoco.MjData(model)
    for name, angle in zip(robot.joints, q, strict=True):
        data.qpos[model.joint(name).qposadr[0]] = angle
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    dof = model.joint(joint).dofadr[0]
    return float(full[dof, dof])


def parameters(servo: Servo, inertia_kgm2: float) -> dict[str, list[float]]:
    """gainprm, biasprm and dynprm (3,) each."""
    wn2 = inertia_kgm2 * servo.natural_frequency**2
    damping = 2.0 * inertia_kgm2 * servo.damping_ratio * servo.natural_frequency
    return {"gainprm": [servo.gain * wn2, 0.0, 0.0], "biasprm": [0.0, -wn2, -damping], "dynprm": [1.0, 0.0, 0.0]}


def element(servo: Servo, joint: str, inertia_kgm2: float) -> str:
    """The `<general>` element."""
    words = {key: " ".join(f"{x:.8g}" for x in value) for key, value in parameters(servo, inertia_kgm2).items()}
    late = ""
    if servo.delay >= TIMESTEP:
        late = f' delay="{servo.delay:.6g}" nsample="{int(np.ceil(servo.delay / TIMESTEP)) + 1}"'
    return (
        f'<general name="{joint}" joint="{joint}" dyntype="none" dynprm="{words["dynprm"]}" gaintype="fixed" '
        f'gainprm="{words["gainprm"]}" biastype="affine" biasprm="{words["biasprm"]}"{late}/>'
    )


def text(servo: Servo, joint: str, inertia_kgm2: float, source: str) -> str:
    """An MJCF file with the actuator alone, to be included."""
    about = (
        f"  <!-- {joint}: K {servo.gain:.4g}, natural frequency {servo.natural_frequency:.4g} rad/s, damping ratio "
        f"{servo.damping_ratio:.3g}, delay {1e3 * servo.delay:.3g} ms.\n       {source}.\n"
        f"       For an inertia of {inertia_kgm2:.4g} kg m2 at the joint, gravity compensated, and a timestep of "
        f"{TIMESTEP:g} s or more.\n       The joint's friction is in these numbers: do not add it again. -->\n"
    )
    return f"<mujoco>\n{about}  <actuator>\n    {element(servo, joint, inertia_kgm2)}\n  </actuator>\n</mujoco>\n"


def simulated(servo: Servo, command: np.ndarray, period: float) -> np.ndarray:
    """Angles (n,) rad of a joint with this actuator, from rest; command (n,) rad, each held for `period` s."""
    hinge = (
        f'<mujoco><option timestep="{TIMESTEP}" gravity="0 0 0" integrator="implicitfast"/><worldbody><body>'
        '<joint name="j" armature="1"/><geom size="0.1" mass="1e-6"/></body></worldbody>'
        f"<actuator>{element(servo, 'j', 1.0)}</actuator></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(hinge)
    model.opt.timestep = period / max(1, round(period / TIMESTEP))
    data, out = mujoco.MjData(model), np.empty(len(command))
    shift = command[0]
    for k, u in enumerate(command - shift):
        out[k] = data.qpos[0]
        data.ctrl[0] = u
        for _ in range(max(1, round(period / TIMESTEP))):
            mujoco.mj_step(model, data)
    return out + servo.gain * shift


def step_error(servo: Servo, traces: Sequence[Trace], steps: Sequence[Step]) -> list[float]:
    """RMS between each step as measured and as simulated with `servo`, as a share of the step's size."""
    by_name = {t.name: t for t in traces}
    out = []
    for step in steps:
        trace = by_name[step.trace]
        first = int(np.searchsorted(trace.time, step.start))
        last = int(np.searchsorted(trace.time, step.start + WINDOW))
        later = [s.start for s in steps if s.trace == step.trace and s.start > step.start]
        last = min(last, int(np.searchsorted(trace.time, min(later)))) if later else last
        before = trace.q[max(0, first - max(2, round(0.1 / trace.period))) : first].mean()
        command = trace.q_cmd[first - 1 : last] - trace.q_cmd[first - 1]
        model = simulated(servo, command, trace.period)[1:]
        out.append(float(np.sqrt(np.mean((trace.q[first:last] - before - model) ** 2)) / abs(step.size)))
    return out
