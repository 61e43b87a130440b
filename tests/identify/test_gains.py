"""Default gains are stable in every posture that a motion visits, whatever the arm weighs there."""

from dataclasses import replace

import numpy as np
import pytest

from vispeg.core.seeds import stream
from vispeg.identify.evidence import Evidence
from vispeg.identify.excitation import motion
from vispeg.identify.gains import COUPLED, IIWA_KD, IIWA_KP, bearable, servo
from vispeg.identify.record import centre_of, controller, record
from vispeg.robots.model import load
from vispeg.worlds.world import World

NOISE = {"q": 2e-5, "dq": 1e-3, "tau": 0.2}
COLUMN = """<mujoco>
  <worldbody>
    <body name="column">
      <joint name="turn" axis="0 0 1" range="-2 2"/>
      <inertial pos="0 0 0.1" mass="1" diaginertia="2e-3 2e-3 2e-3"/>
      <body name="arm" pos="0 0 0.2">
        <joint name="lift" axis="0 1 0" range="-0.7 1.7"/>
        <inertial pos="0 0 0.4" mass="2" diaginertia="1e-2 1e-2 5e-4"/>
        <site name="flange" pos="0 0 0.6"/>
      </body>
    </body>
  </worldbody>
</mujoco>"""  # without rotor inertia: raised, it turns with 0.0025 kg m^2; at its centre posture with 0.08


@pytest.fixture
def column(tmp_path):
    path = tmp_path / "column.xml"
    path.write_text(COLUMN)
    return path


def recorded(path, control):
    robot = load(str(path))
    made = motion("fourier", robot, control.rate_hz, 4.0, stream(1, "gains"))
    return record(World(str(path)), made, control, NOISE, stream(2, "gains")), made


def test_an_arm_without_rotor_inertia_follows_and_its_own_model_is_adequate(column):
    robot = load(str(column))
    centre = centre_of(robot)
    rec, made = recorded(column, controller(robot, "position", 500.0, centre))
    assert np.abs(rec.q - made.q_cmd).max() < 0.1
    evidence = Evidence([rec], h_max=5e-4)
    assert np.sum(evidence.residuals([World(str(column))])[0] ** 2) / evidence.count < 1.3
    at_centre = np.array([0.1 * 2.0 * 0.4**2 * np.sin(0.5) ** 2 * 500.0, rec.control.kd[1]])  # 2 * 25 rad/s * J
    shaken, _ = recorded(column, controller(robot, "position", 500.0, centre, rec.control.kp, at_centre))
    assert np.abs(np.diff(shaken.dq[:, 0])).max() > 20 * np.abs(np.diff(rec.dq[:, 0])).max()


@pytest.mark.parametrize("seed", range(20))
def test_no_posture_is_damped_past_the_bound(seed):
    """The eigenvalues of M^-1 diag(kd) dt, by themselves, for inertias of any coupling."""
    rng = np.random.default_rng(seed)
    factors = rng.normal(size=(30, 5, 5)) * np.exp(rng.normal(size=5))
    mobility = factors @ np.swapaxes(factors, 1, 2)
    wished = np.exp(rng.normal(size=5))
    kd = bearable(mobility, wished, 500.0)
    eigenvalues = np.linalg.eigvals(mobility * kd / 500.0).real
    assert eigenvalues.max() <= COUPLED * (1 + 1e-9)
    rows = np.abs(mobility) * np.sqrt(wished[:, None] * wished) / 500.0
    np.testing.assert_allclose(kd / wished * rows.sum(axis=2).max(axis=0), COUPLED)


def test_one_joint_bears_what_its_least_inertia_bears():
    inertia = np.array([0.5, 0.02, 2.0])
    assert bearable(1.0 / inertia[:, None, None], np.array([3.0]), 100.0) == pytest.approx(COUPLED * 0.02 * 100.0)


def test_the_table_of_the_iiwa_holds_at_its_rate():
    robot = load("iiwa14")
    kp, kd = servo(robot, centre_of(robot), 500.0)
    assert tuple(kp) == IIWA_KP and tuple(kd) == IIWA_KD
    slow = servo(replace(robot, name="other"), centre_of(robot), 100.0)[1]
    assert (slow <= servo(replace(robot, name="other"), centre_of(robot), 500.0)[1]).all()
