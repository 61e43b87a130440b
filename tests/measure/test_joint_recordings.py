"""A joint that is known, in recordings: the numbers depend on neither their names, nor episodes, nor joints' order."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vispeg.api.measure.joint import measure_joint
from vispeg.measure.arm import arm_of
from vispeg.measure.steps import step_answer
from vispeg.measure.trace import from_recording, most_moved
from vispeg.recordings.recording import Control, Recording, in_order
from vispeg.recordings.write import write
from vispeg.robots.model import load

RATE = 200.0
JOINTS = load("iiwa14").joints


def steps(size, wn, hold, joint="joint1"):
    """A recording of two steps up and down by `size` rad, which this joint answers like a servo of wn rad/s."""
    time = np.arange(round(5 * hold * RATE)) / RATE
    goals = size * np.array([0.0, 1.0, 0.0, -1.0, 0.0])
    moves = [(k * hold, b - a) for k, (a, b) in enumerate(zip(goals, goals[1:], strict=False), 1)]
    noise = 1e-6 * np.random.default_rng(round(wn)).standard_normal(len(time))
    q_cmd = np.tile(np.linspace(0.2, 0.9, 7), (len(time), 1))
    q = q_cmd + noise[:, None]
    j = JOINTS.index(joint)
    q_cmd[:, j] += np.repeat(goals, round(hold * RATE))
    q[:, j] += sum(by * step_answer(time - at, wn, 0.7) for at, by in moves)
    return Recording(Path("r"), "iiwa14", JOINTS, RATE, Control("servo", RATE), time, q, q_cmd=q_cmd)


def joined(parts):
    """These recordings as the episodes of one."""
    arrays = {name: np.concatenate([getattr(p, name) for p in parts]) for name in ("time", "q", "q_cmd")}
    return replace(parts[0], episode=np.repeat(np.arange(len(parts)), [len(p.time) for p in parts]), **arrays)


def found(paths, out):
    measured = measure_joint(paths, out, joint="joint1", inertia=1.0).measurement
    return {q.quantity: (q.value, q.low, q.high) for q in measured.results}


@pytest.fixture(scope="module")
def apart(tmp_path_factory):
    """Two motions with steps at different times, what they show in folders of different names, and the folder."""
    folder = tmp_path_factory.mktemp("apart")
    parts = [steps(0.1, 20.0, 0.7), steps(0.04, 40.0, 1.0)]
    paths = [write(part, folder / name) for part, name in zip(parts, ("r", "s"), strict=True)]
    return parts, found(paths, folder / "out"), folder


def test_recordings_of_one_name_in_two_folders_are_two(apart, tmp_path):
    parts, numbers, _ = apart
    paths = [write(part, tmp_path / day / "run") for part, day in zip(parts, ("day1", "day2"), strict=True)]
    assert found(paths, tmp_path / "out") == numbers
    assert 20.0 < numbers["natural_frequency"][0] < 40.0


def test_episodes_of_one_recording_are_motions_of_their_own(apart, tmp_path):
    parts, numbers, _ = apart
    assert found([write(joined(parts), tmp_path / "both")], tmp_path / "out") == numbers


@pytest.mark.parametrize("joints", [JOINTS[::-1], JOINTS[:6]], ids=["reversed", "without the last"])
def test_inertia_and_torque_of_a_joint_do_not_depend_on_the_others_columns(joints, tmp_path):
    """The last joint stands at 0, where it is held if the log lacks it."""
    whole = steps(0.1, 20.0, 0.7, "joint2")
    q, q_cmd = whole.q.copy(), whole.q_cmd.copy()
    q[:, 6] = q_cmd[:, 6] = 0.0
    law = Control("position", RATE, "model", np.linspace(900.0, 300.0, 7), np.linspace(90.0, 30.0, 7))
    whole = replace(whole, q=q, q_cmd=q_cmd, control=law)
    n = len(joints)
    less = replace(law, kp=law.kp[:n], kd=law.kd[:n])
    some = in_order(replace(whole, joints=JOINTS[:n], q=q[:, :n], q_cmd=q_cmd[:, :n], control=less), joints)
    assert arm_of(some, "joint2").held == pytest.approx(arm_of(whole, "joint2").held, rel=1e-9)
    paths = [write(rec, tmp_path / name) for rec, name in ((whole, "whole"), (some, "some"))]
    (one,), (other,) = (from_recording(path, "joint2")[0] for path in paths)
    assert other.tau == pytest.approx(one.tau, rel=1e-9) and np.abs(one.tau[0]) > 10.0


LAW = Control("position", RATE, "none", np.full(7, 900.0), np.full(7, 90.0))


def asked_of(rec, folder):
    """The torques that the control law asks of joint1, one array an episode."""
    traces, _ = from_recording(write(replace(rec, control=LAW), folder), "joint1")
    assert all(trace.asked for trace in traces)
    return [trace.tau for trace in traces]


def test_a_torque_does_not_depend_on_whether_the_clock_restarts(tmp_path):
    """An angle jumps between two episodes, but no joint turns then."""
    both = joined([steps(0.1, 20.0, 0.7), steps(0.04, 40.0, 1.0)])
    q, q_cmd = both.q.copy(), both.q_cmd.copy()
    q[both.episode == 1] += 0.8
    q_cmd[both.episode == 1] += 0.8
    both = replace(both, q=q, q_cmd=q_cmd)
    running = replace(both, time=np.arange(len(both.time)) / RATE)
    for one, other in zip(asked_of(both, tmp_path / "a"), asked_of(running, tmp_path / "b"), strict=True):
        assert other == pytest.approx(one, abs=1e-6)


def test_a_missing_reading_costs_its_row_and_no_more(tmp_path):
    """Of the angle, of the speed, of the motor's torque; a torque that is mostly missing costs itself, and is said."""
    whole = steps(0.1, 20.0, 0.7)
    (full,) = asked_of(whole, tmp_path / "whole")
    q = whole.q.copy()
    q[50, 0] = np.nan  # at rest, so that its neighbours' speeds are as before
    (tau,) = asked_of(replace(whole, q=q), tmp_path / "q")
    assert tau == pytest.approx(np.delete(full, 50), abs=1e-2)
    given = np.tile(np.sin(whole.time)[:, None], 7)
    given[50, 0] = np.nan
    for name, signals in (("dq", {"dq": given}), ("tau", {"tau": given, "torque_sensor": "motor"})):
        path = write(replace(whole, control=LAW, **signals), tmp_path / name)
        (trace,), _ = from_recording(path, "joint1")
        assert len(trace.tau) == len(trace.q) == len(whole.time) - 1 and np.isfinite(trace.tau).all(), name
        assert trace.asked is (name == "dq")
    some = np.where(np.arange(len(given))[:, None] % 2, np.nan, given)
    path = write(replace(whole, tau=some, torque_sensor="motor"), tmp_path / "some")
    (trace,), _ = from_recording(path, "joint1")
    assert trace.tau is None and "missing in more than" in trace.why and len(trace.q) == len(whole.time)


def test_a_sensor_that_gave_no_torque_measured_none(tmp_path):
    """The header names the motor's sensor, but the torque is the law's."""
    asked_of(replace(steps(0.1, 20.0, 0.7), torque_sensor="motor"), tmp_path / "r")


def test_the_joint_is_the_one_that_moves_most_in_any_of_the_recordings(tmp_path):
    """In whichever order they are named, and though another has no commands."""
    small, large = steps(0.04, 20.0, 0.7, "joint3"), steps(0.1, 20.0, 0.7, "joint2")
    for rec in (small, large):
        rec.q_cmd[:, 6] = np.nan
    named = ((small, "small"), (large, "large"))
    paths = [write(replace(rec, control=Control("unknown", RATE)), tmp_path / name) for rec, name in named]
    assert most_moved(paths[:1]) == "joint3"
    assert most_moved(paths) == most_moved(paths[::-1]) == "joint2"
