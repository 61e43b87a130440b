"""Hidden effects from the benchmark's development set: the diagnosis sees only the recordings.

The plant is not the model's code (scripts/bench/hidden_effects): another step size, other equations, sensor noise.
"""

from __future__ import annotations

import numpy as np
import pytest
from cases import DEV, choose
from hidden import Hide
from loop import GAINS, _Delayed, _Sensors
from make import folders, make
from plant import Plant

from vispeg.diagnosis.run import diagnose
from vispeg.recordings.load import load
from vispeg.worlds.world import World

NAMED = [
    "viscous_friction/joint6/small",
    "cogging/joint1/small",
    "torque_limit/joint4/small",
    "coulomb_friction/joint4/small",
    "viscous_friction/joint1/small",
    "hysteresis/joint1/small",
    "joint_elasticity/joint2/small",
    "backlash/joint1/small",
    "cable_spring/joint4/small",
]


def verdict(name: str, folder) -> dict:
    (case,) = choose((name,), DEV)
    make(folder, [case])
    first, second, last = (load(f) for f in folders(folder, case))
    return diagnose(World(), [first, second], [last], nthread=1, plan_next=False).record


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", NAMED)
def test_the_hidden_effect_is_named_and_the_error_falls(name, tmp_path):
    kind, where, _ = name.split("/")
    record = verdict(name, tmp_path)
    assert record["verdict"] in ("identified", "ambiguous"), record["reason"]
    assert [(e["effect"], e["where"]) for e in record["effects"]] == [(kind, where)]
    errors = [rung["heldout_error"] for rung in record["ladder"]]
    assert errors[-1] < errors[0] / 8


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", ["none/07", "none/02"])
def test_nothing_hidden_nothing_named(name, tmp_path):
    record = verdict(name, tmp_path)
    assert record["verdict"] == "adequate" and record["effects"] == []


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_disturbance_outside_the_library_gets_no_name(tmp_path):
    record = verdict("vibration/joint2/large", tmp_path)
    assert record["verdict"] == "unexplained" and record["effects"] == []
    assert record["unexplained"]["text"]


def plant_of(effect: str, where: str = "joint4", **params: float) -> Plant:
    return Plant([(Hide(effect, where, params),)], np.zeros((1, 7)))


def test_a_command_arrives_when_the_hidden_delay_says_not_when_a_tick_does():
    """The torque that a step of the command brings in 6 ms is the step times what the delay leaves of them."""
    drives, delay = _Delayed(plant_of("command_delay", delay=2.73e-3)), 2.73e-3
    drives.send(np.zeros((1, 7)))
    push = np.zeros(7)
    for _ in range(3):  # control periods of 2 ms
        drives.send(np.ones((1, 7)))
        push += sum(drives.at(i)[0] for i in range(drives.sub)) * 2e-4
    assert push[3] == pytest.approx(6e-3 - delay, abs=1e-12)
    assert push[[0, 1, 2, 4, 5, 6]] == pytest.approx(6e-3, abs=1e-12)


def test_a_drive_that_lags_gives_the_torque_of_the_closed_form():
    """The integral of 1 - exp(-t / T) over 3 ms is 3 ms - T (1 - exp(-3 ms / T))."""
    plant, t = plant_of("actuator_lag", time_constant=1.7e-3), 1.7e-3
    push = sum(plant._motor(np.ones((1, 7)), plant.q)[0, 3] for _ in range(15)) * 2e-4
    assert push == pytest.approx(3e-3 - t * (1.0 - np.exp(-3e-3 / t)), rel=1e-9)


def test_a_late_sensor_reads_a_steady_turn_where_it_was():
    delay = 1.31e-3
    plant = plant_of("sensor_delay", delay=delay)
    sense = _Sensors(plant, [1], 1, noise=False)
    for tick in range(1, 21):
        plant.q[:] = 0.5 * tick * plant.h  # rad at 0.5 rad/s
        sense.push()
    q, _, _ = sense.read()
    assert q[0, 3] == pytest.approx(0.5 * (20 * plant.h - delay), abs=1e-12)
    assert q[0, 2] == pytest.approx(0.5 * 20 * plant.h, abs=1e-12)


@pytest.mark.slow
def test_a_soft_case_hides_many_and_its_folder_states_soft_gains(tmp_path):
    """A position loop of an eighth of the stiffness, and no word of what is hidden."""
    case = choose((), DEV, 3, "soft")[0]
    assert 15 <= len(case.hidden) <= 25
    make(tmp_path, [case])
    stiff = GAINS["position"][0]
    for folder in folders(tmp_path, case):
        recording = load(folder)
        assert recording.control.mode == "position"
        assert recording.control.kp == pytest.approx([k / 8 for k in stiff], rel=0.02)
        assert np.abs(recording.q - recording.q_cmd).max() > 0.05  # rad: it sags
