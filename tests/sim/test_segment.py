"""From recordings to what a rollout is driven by."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loops import KD, KP, iiwa_segment

from vispeg.core.effect import EffectInstance
from vispeg.recordings.checks.missing import said
from vispeg.recordings.recording import Control, Recording
from vispeg.robots.model import load
from vispeg.sim import compiled
from vispeg.sim.compiled import flange_pose
from vispeg.sim.rollout import simulate
from vispeg.sim.segments.along import gravity, gravity_slope, inertia
from vispeg.sim.segments.segment import segments
from vispeg.worlds.world import World

JOINTS = load("iiwa14").joints


def recording(rate=500.0, control_rate=500.0, n=600, **changes) -> Recording:
    time = np.arange(n) / rate
    q = 0.3 * np.sin(2 * np.pi * 0.5 * time)[:, None] * np.ones(7)
    control = Control("position", control_rate, "model", KP, KD)
    return replace(Recording(Path("made-up"), "iiwa14", JOINTS, rate, control, time, q, q_cmd=q), **changes)


def test_on_one_clock_commands_pass_untouched():
    rec = recording()
    (s,) = segments(rec)
    np.testing.assert_array_equal(s.command["q_cmd"], rec.q_cmd)
    np.testing.assert_array_equal(s.q_raw, rec.q)
    assert s.ticks == 600 and s.tick == 1 / 500


def test_episodes_become_segments_of_their_own_time():
    rec = recording(episode=np.repeat([3, 7], 300))
    first, second = segments(rec)
    assert (first.rows[0], second.rows[0]) == (0, 300)
    np.testing.assert_allclose(second.time, np.arange(300) / 500.0, atol=1e-12)
    np.testing.assert_array_equal(second.command["q_cmd"], rec.q_cmd[300:])


def test_another_clock_is_interpolated():
    """A 250 Hz log of a 1 kHz loop: the command on the loop's ticks is that of the motion."""
    (s,) = segments(recording(rate=250.0, control_rate=1000.0))
    assert s.ticks == 599 * 4 + 1
    exact = 0.3 * np.sin(2 * np.pi * 0.5 * np.arange(s.ticks) / 1000.0)
    np.testing.assert_allclose(s.command["q_cmd"][:, 2], exact, atol=1e-5)


def test_gaps_are_bridged_by_lines():
    q = recording().q.copy()
    q[100:110, 3] = np.nan
    (s,) = segments(recording(q=q))
    assert np.isfinite(s.q).all() and np.isfinite(s.q_raw).all()
    np.testing.assert_allclose(s.q_raw[100:110, 3], np.interp(np.arange(100, 110), [99, 110], q[[99, 110], 3]))
    np.testing.assert_array_equal(np.delete(s.q_raw, 3, axis=1), np.delete(q, 3, axis=1))
    assert np.isnan(q[105, 3])  # the caller's array is as it was


def test_a_long_gap_cuts_an_episode():
    """What the motion did for 0.2 s nobody knows: each side has a start state of its own, from readings."""
    q = recording().q.copy()
    q[:3, 1], q[200:300, 3], q[400:410, 5] = np.nan, np.nan, np.nan
    driven = recording(q=q, tau_cmd=recording().q, control=Control("torque", 500.0))
    first, second = segments(driven)
    assert (first.rows[0], first.rows[-1], second.rows[0], second.rows[-1]) == (3, 199, 300, 599)
    np.testing.assert_array_equal(second.command["tau_cmd"], recording().q[300:])
    np.testing.assert_allclose(second.q[0], q[300], atol=1e-4)


def test_a_stiff_loop_goes_on_where_angles_are_missing_and_stops_where_commands_are():
    q = recording().q.copy()
    q[:3, 1], q[200:300, 3] = np.nan, np.nan
    (s,) = segments(recording(q=q))
    assert (s.rows[0], s.rows[-1]) == (3, 599)
    goals = recording().q.copy()
    goals[200:300] = np.nan
    assert [(s.rows[0], s.rows[-1]) for s in segments(recording(q_cmd=goals))] == [(0, 199), (300, 599)]


@pytest.mark.parametrize("mode", ["position", "torque"])
def test_lost_rows_cut_an_episode_as_empty_ones_do(mode):
    """A short loss is bridged either way."""
    rec = recording(control=Control(mode, 500.0, "model", KP, KD), tau_cmd=np.ones((600, 7)))
    lost = np.r_[200:300, 400:420]
    here = np.setdiff1d(np.arange(600), lost)
    parts = {f: getattr(rec, f)[here] for f in ("time", "q", "q_cmd", "tau_cmd")}
    blank = {f: getattr(rec, f).copy() for f in ("q", "q_cmd", "tau_cmd")}
    for values in blank.values():
        values[lost] = np.nan
    without, empty = segments(replace(rec, **parts)), segments(replace(rec, **blank))
    assert [s.begun for s in without] == [s.begun for s in empty] == [0.0, 0.6]
    for a, b in zip(without, empty, strict=True):
        assert a.ticks == b.ticks and a.time[-1] == b.time[-1]
        for name in a.command:
            np.testing.assert_allclose(a.command[name], b.command[name], atol=1e-12)
        np.testing.assert_allclose(a.q, b.q, atol=1e-12)
    assert said(replace(rec, **parts))[-1] == (
        "made-up: no rows for 0.202 s from 0.398 s on; what is before and after is simulated separately"
    )


@pytest.mark.parametrize("mode", ["position", "torque"])
def test_a_bus_that_drops_a_joint_in_every_cycle_is_bridged(mode):
    """No row has all joints, and yet no joint is unread for longer than two rows."""
    q = recording().q.copy()
    for joint in range(7):
        q[joint::7, joint] = np.nan
    control = Control("position", 500.0, "model", KP, KD) if mode == "position" else Control("torque", 500.0)
    (s,) = segments(recording(q=q, tau_cmd=recording().q, control=control))
    assert s.rows[0] <= 1 and s.rows[-1] == 599
    np.testing.assert_allclose(s.q_raw[3:-3], recording().q[s.rows][3:-3], atol=1e-4)


def test_start_state_is_smoothed_measurement():
    """Noise of 0.1 mrad leaves the start angle and speed of a slow motion right."""
    rng = np.random.default_rng(1)
    rec = recording()
    (s,) = segments(replace(rec, q=rec.q + rng.normal(scale=1e-4, size=rec.q.shape)))
    inner = slice(50, -50)
    rate = 0.3 * 2 * np.pi * 0.5 * np.cos(2 * np.pi * 0.5 * rec.time)[:, None]
    assert np.sqrt(np.mean((s.q - rec.q)[inner] ** 2)) < 5e-5
    assert np.sqrt(np.mean((s.dq - rate)[inner] ** 2)) < 5e-3


def slow_log(q, rate, sigma):
    control = Control("servo", rate, "model", KP, KD)
    time = np.arange(len(q)) / rate
    return Recording(Path("slow"), "iiwa14", JOINTS, rate, control, time, q, q_cmd=q, noise={"q": sigma})


def test_a_servo_s_start_is_estimated_from_readings_not_from_points_between_them():
    """At rest, 30 Hz: the velocity error is that of a cubic over 0.6 s of 19 readings (see test_start)."""
    rng, sigma = np.random.default_rng(2), 1e-3
    logs = [slow_log(rng.normal(scale=sigma, size=(60, 7)), 30.0, sigma) for _ in range(60)]
    found = [segments(log)[0].dq[0] for log in logs]
    expected = 10 * np.sqrt(12) * sigma / (0.6 * np.sqrt(19))
    # the median, as in one draw of 20 noise alone shortens the window
    assert 0.8 * expected < np.median(np.abs(found)) / 0.6745 < 1.35 * expected


def test_a_log_with_few_readings_does_not_start_at_rest():
    """8 Hz leaves five readings in the longest window: too few for a fit, enough for a velocity."""
    time = np.arange(40) / 8.0
    (s,) = segments(slow_log(0.2 * time[:, None] * np.ones(7), 8.0, 1e-4))
    np.testing.assert_allclose(s.dq[0], 0.2, atol=1e-6)


def test_poses_between_samples_do_not_depend_on_the_signs_of_quaternions():
    turn = 0.4 * np.arange(300) / 300
    pose = np.column_stack([*np.full((3, 300), 0.3), np.cos(turn / 2), np.sin(turn / 2), 0 * turn, 0 * turn])
    osc = recording(n=300, rate=250.0, q_cmd=None, ee_cmd=pose, control=Control("osc", 500.0, "model"))
    mixed = pose.copy()
    mixed[100:150, 3:] *= -1
    mixed[120, 3:] = np.nan
    (s,), (other,) = segments(osc), segments(replace(osc, ee_cmd=mixed))
    np.testing.assert_allclose(other.command["ee_cmd"], s.command["ee_cmd"], atol=1e-6)
    np.testing.assert_allclose(s.command["ee_cmd"][:, 4], np.sin(0.2 * np.arange(599) / 600), atol=1e-6)


def test_a_stretch_shorter_than_a_control_period_is_no_segment():
    assert segments(recording(rate=500.0, control_rate=100.0, n=3)) == []


def test_what_follows_from_the_posture_is_the_same_however_many_are_simulated_at_once(monkeypatch):
    """Gravity, its slope and inertia along a motion, bit for bit; the memory of a long one is that of a short one."""
    robot, (s,) = load("iiwa14"), segments(recording())
    whole = [get(s, robot) for get in (gravity, gravity_slope, inertia)] + [flange_pose(robot, s.q)]
    monkeypatch.setattr(compiled, "BATCH", 7)
    monkeypatch.setattr(compiled, "nominal_of", few := counted(compiled.nominal_of))
    some = [get(s, robot) for get in (gravity, gravity_slope, inertia)] + [flange_pose(robot, s.q)]
    for a, b in zip(whole, some, strict=True):
        np.testing.assert_array_equal(a, b)
    assert len(few.sizes) == 4 * 86 and max(few.sizes) == 7
    step = np.linalg.norm(some[1][0] - np.swapaxes(some[1][0], 0, 1))  # the slope of a potential's slope
    assert step < 1e-6 * np.linalg.norm(some[1][0])


def counted(made):
    """`made`, which remembers how many arms each call simulates."""

    def make(robot, nsim, nthread=1):
        make.sizes.append(nsim)
        return made(robot, nsim, nthread)

    make.sizes = []
    return make


@pytest.mark.parametrize("mode", ["position", "osc"])
def test_a_segment_up_to_a_sample_is_driven_as_the_whole_one_is_until_then(mode):
    whole = iiwa_segment(mode, 0.6)
    world = World().add(EffectInstance.of("viscous_friction", "joint4", damping=0.5))
    start = whole.until(200)
    assert start.ticks == len(start.time) == 200 and whole.ticks > 250
    long, short = (simulate(load("iiwa14"), [world], [s], along=True)[0] for s in (whole, start))
    np.testing.assert_array_equal(short.q[0], long.q[0, :200])


def test_a_segment_between_two_ticks_ends_behind_its_last_sample():
    whole = iiwa_segment("position", 0.2)
    late = replace(whole, time=whole.time[:-1:2] + 0.0007, rows=whole.rows[:-1:2])
    start = late.until(20)
    assert len(start.time) == 20 and (start.ticks - 2) * start.tick < start.time[-1] <= (start.ticks - 1) * start.tick
