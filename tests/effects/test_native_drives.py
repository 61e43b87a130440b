"""Command delay and actuator lag beside MuJoCo's own: where they are the same, and where MuJoCo's is not exact."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from vispeg.effects.common.delay import DelayLine
from vispeg.effects.drive.actuator_lag import ActuatorLag
from vispeg.sim.state import DriveState

H, SENT, STEPS = 1e-3, 2, 14  # s; the step from which 1 N m is commanded; number of steps


def native(actuator: str) -> np.ndarray:
    """Return the torque, N m, that an actuator of MuJoCo gives in each physics step after a jump of its command."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{H}" gravity="0 0 0"/><worldbody><body>
        <joint name="j" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody>
        <actuator><general joint="j" gainprm="1" {actuator}/></actuator></mujoco>"""
    )
    data, out = mujoco.MjData(model), []
    for k in range(STEPS):
        data.ctrl[0], before = float(k >= SENT), data.qvel[0]
        mujoco.mj_step(model, data)
        out.append((data.qvel[0] - before) / H)
    return np.array(out)


def ours(act) -> np.ndarray:
    """Return the same of an effect, given as a function of the command (1, 1)."""
    return np.array([float(act(np.array([[float(k >= SENT)]]))[0, 0]) for k in range(STEPS)])


def exact(steps: float) -> np.ndarray:
    """Return the mean torque in each step when the jump acts `steps` steps late."""
    return np.clip(np.arange(STEPS) + 1 - SENT - steps, 0.0, 1.0)


@pytest.mark.parametrize("steps", [0.3, 0.7, 1.0, 1.5, 2.0, 4.25])
def test_a_delay_of_a_step_or_more_is_mujocos_and_a_shorter_one_is_exact_here_alone(steps):
    line, delay = DelayLine(H, steps * H), np.array([[steps * H]])
    torque = ours(lambda command: line(command, delay))
    np.testing.assert_allclose(torque, exact(steps), atol=1e-9)
    theirs = native(f'delay="{steps * H}" nsample="20" interp="linear"')
    np.testing.assert_allclose(theirs, exact(max(steps, 1.0)), atol=1e-9)


@pytest.mark.parametrize("steps", [0.5, 2.0, 10.0])
def test_a_lag_gives_the_mean_torque_of_a_step_between_mujocos_of_its_ends(steps):
    kind, p = ActuatorLag(), {"time_constant": np.array([[steps * H]])}
    zero = np.zeros((1, 1))
    x = DriveState(H, H, zero, zero, zero, zero, zero)
    state = kind.start(x, p)
    torque = ours(lambda command: kind.drive(state, command, x, p))
    late, early = (native(f'dyntype="filterexact" dynprm="{steps * H}" actearly="{a}"') for a in ("false", "true"))
    n = np.maximum(np.arange(STEPS) - SENT, 0)
    after = np.arange(STEPS) >= SENT
    np.testing.assert_allclose(early, np.where(after, 1 - np.exp(-(n + 1) / steps), 0.0), atol=1e-9)
    np.testing.assert_allclose(late[SENT + 1 :], early[SENT:-1], atol=1e-9)
    mean = 1 - steps * (np.exp(-n / steps) - np.exp(-(n + 1) / steps))  # of 1 - exp(-t/T) over the step
    np.testing.assert_allclose(torque, np.where(after, mean, 0.0), atol=1e-9)
