"""Known jitter, gaps, quantization, noise, clipping and poor motions are found, and their absence is not."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from loops import iiwa_segment, recorded
from made import recording
from typed import typed

import vispeg
from vispeg.core.assets import assets
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.identify.drives import sent
from vispeg.recordings.checks.check import check
from vispeg.recordings.checks.cleared import cleared
from vispeg.recordings.checks.excitation import PARAMETERS, excitation, regressor
from vispeg.recordings.checks.missing import said
from vispeg.recordings.checks.quality import Limits, quantization, saturated
from vispeg.recordings.checks.spikes import spikes
from vispeg.recordings.checks.timing import held, timing
from vispeg.recordings.importers import fits
from vispeg.recordings.noise import highpass_sigma, noise_from_repeats, noise_of
from vispeg.recordings.recording import Control
from vispeg.recordings.write import write
from vispeg.robots.model import load, load_for
from vispeg.sim.units import check_units, needs_of
from vispeg.worlds.world import World

RATE = 500.0


def moving(n=5000, seed=0, noise_q=1e-5, noise_tau=0.2, **changes):
    """Two joints on sines of 10 s with white noise on angle and torque."""
    rng = np.random.default_rng(seed)
    time = np.arange(n) / RATE
    q = np.stack(
        [0.8 * np.sin(2 * np.pi * 0.5 * time), 0.4 * np.sin(2 * np.pi * 0.3 * time) + 0.3 * np.sin(5 * time)], 1
    )
    tau = np.stack([20 * np.sin(time), 5 * np.cos(time)], 1)
    fields = {
        "time": time,
        "q_cmd": q,
        "q": q + rng.normal(scale=noise_q, size=q.shape),
        "tau": tau + rng.normal(scale=noise_tau, size=q.shape),
    }
    empty = dict.fromkeys(("dq", "tau_cmd", "ee", "ee_cmd", "ft"))
    return recording(n, RATE, **(empty | fields | changes))


def test_a_clean_recording_draws_no_warning():
    assert check(moving(), Limits(np.full((2, 2), [-3.0, 3.0]), np.full(2, 5.0), np.full(2, 100.0))).warnings == ()


def test_jitter_is_measured():
    rng = np.random.default_rng(1)
    time = np.arange(5000) / RATE + rng.normal(scale=1e-4, size=5000)
    clock = timing(moving(time=time))
    assert clock.jitter == pytest.approx(np.sqrt(2) * 1e-4, rel=0.05)  # two jittered times make a period
    assert clock.rate_hz == pytest.approx(RATE, rel=1e-2) and clock.gaps == ()


def test_gaps_are_counted_sized_and_placed():
    keep = np.ones(5000, bool)
    keep[1000:1004] = keep[3000] = False
    rec = moving(time=(np.arange(5000) / RATE)[keep], **{k: getattr(moving(), k)[keep] for k in ("q", "q_cmd", "tau")})
    gaps = timing(rec).gaps
    assert [(g.samples, round(g.start, 6)) for g in gaps] == [(4, 1.998), (1, 5.998)]
    assert gaps[0].seconds == pytest.approx(5 / RATE)
    assert any("2 gaps, 5 samples lost" in line for line in check(rec).warnings)


def test_a_new_episode_is_no_gap():
    time = np.tile(np.arange(2500) / RATE, 2)
    clock = timing(moving(time=time, episode=np.repeat([0, 1], 2500)))
    assert (clock.gaps, clock.episodes) == ((), 2) and clock.duration_s == pytest.approx(2 * 2499 / RATE)


def test_a_clock_that_runs_on_between_episodes_is_as_good_as_one_that_restarts():
    """Postures 1 rad apart: there is no speed, torque or drive torque between them."""
    n, rate, rng = 600, 100.0, np.random.default_rng(0)
    time, number = np.arange(n) / rate, np.repeat([0, 1], n // 2)
    ideal = np.stack([0.3 * np.sin(2 * time), 0.2 * np.cos(3 * time)], 1) + number[:, None]
    q = ideal + rng.normal(scale=1e-5, size=ideal.shape)
    q[n // 2 - 4 : n // 2 + 4, 1] = np.nan
    changes = {"time": time, "q": q, "q_cmd": ideal, "dq_cmd": None, "tau": 10 * np.cos(ideal), "episode": number}
    on = replace(moving(n, **changes), rate_hz=rate)
    again = replace(on, time=np.tile(time[: n // 2], 2))
    limits = Limits(np.full((2, 2), [-3.0, 3.0]), np.full(2, 2.0), np.full(2, 100.0))
    one, two = (check(rec, limits) for rec in (on, again))
    assert one.warnings == two.warnings and max(joint.excitation.peak_speed for joint in one.joints) < 0.7
    for a, b in zip(one.joints, two.joints, strict=True):
        assert a.excitation.peak_speed == pytest.approx(b.excitation.peak_speed, rel=1e-6)
    for a, b in zip(fits.motion_of(on, n)[0], fits.motion_of(again, n)[0], strict=True):
        assert np.allclose(a, b, atol=1e-6)
    assert [line.partition("(")[0] for line in said(on)] == [line.partition("(")[0] for line in said(again)]
    assert "at most 4 in a row, from 2.96 s on" in said(on)[0]
    control = Control("position", rate, "none", np.full(2, 50.0), np.full(2, 5.0))
    one, two = (sent(replace(rec, control=control), None) for rec in (on, again))
    assert np.allclose(one, two, atol=1e-4, equal_nan=True) and np.nanmax(np.abs(one)) < 5


def test_missing_held_and_zeroed_readings():
    rec = moving()
    rec.q[100:110, 1] = np.nan
    report = check(rec)
    assert report.joints[1].missing == pytest.approx(10 / 5000) and report.joints[0].missing == 0
    assert report.joints[1].longest_missing_s == pytest.approx(11 / RATE)
    held = moving(noise_q=0.0)
    for row in (510, 1020, 1500):  # fast stretches
        held.q[row], held.tau[row] = held.q[row - 1], held.tau[row - 1]
    assert timing(held).repeated == 3 and timing(moving(noise_q=0.0)).repeated == 0
    lost = moving()
    lost.q[[400, 401, 900]] = 0.0
    assert timing(lost).zeroed == 3


@pytest.mark.parametrize("size, count", [(-3.14, 1), (0.05, 1), (0.4, 2)])
def test_a_single_bad_reading_is_named_and_left_out(size, count):
    rec, clean = moving(), check(moving()).joints[0]
    rec.q[2718 : 2718 + count, 0] += size
    report = check(rec)
    joint = report.joints[0]
    assert [spike.row for spike in joint.spikes] == list(range(2718, 2718 + count))
    assert joint.spikes[0].size == pytest.approx(size, abs=0.02) and joint.spikes[0].time == rec.time[2718]
    assert joint.excitation.peak_speed == pytest.approx(clean.excitation.peak_speed, rel=1e-3)
    assert (joint.low, joint.high) == pytest.approx((clean.low, clean.high), abs=1e-3)
    said = " ".join(report.warnings)
    assert "joint1: " in said and "away and back" in said and ("sample 2719" in said or count > 1)


def test_a_bad_reading_is_compared_as_an_empty_one():
    """It had counted as a loop that loses the arm: a third of the recording was left out."""
    rec = recorded(load("iiwa14"), "iiwa14", World(), iiwa_segment("position", 2.0), stream(8, 3))
    bad, empty = (replace(rec, q=rec.q.copy()) for _ in range(2))
    bad.q[700, 3] += 1.8
    empty.q[700, 3] = np.nan
    one, two = (vispeg.compare("iiwa14", r, threads=1).record for r in (bad, empty))
    assert one["joints"] == two["joints"] and one["where_it_fails"] == two["where_it_fails"]
    assert [line.partition(": ")[2] for line in one["notes"]] == [
        "one angle jumps away and back (joint4; the first at 1.4 s): left out"
    ]
    assert "q.joint4" in two["notes"][0]


def test_a_reading_that_is_held_until_the_next_is_compared_once():
    """As a log of 500 Hz holds those of a sensor of 100 Hz; each was up to 8 ms late, 150 times the noise."""
    rec = recorded(load("iiwa14"), "iiwa14", World(), iiwa_segment("position", 2.0), stream(8, 3))
    rows, late = np.arange(1000) // 5 * 5, np.arange(1000) % 5 > 0
    repeats = replace(rec, q=rec.q[rows], tau=rec.tau[rows])
    empty = replace(rec, **{n: np.where(late[:, None], np.nan, getattr(rec, n)) for n in ("q", "tau")})
    assert timing(repeats).repeated > 770
    once = cleared(repeats)
    assert once.held is not None and cleared(once) is once and np.array_equal(once.q, repeats.q)
    found = [noise_of(replace(cleared(r), noise={}))["q"] for r in (rec, repeats)]
    assert np.allclose(found, 2e-5, rtol=0.3)
    one, two = (vispeg.compare("iiwa14", r, threads=1).record for r in (repeats, empty))
    for a, b in zip(one["joints"], two["joints"], strict=True):
        assert a["error"] == pytest.approx(b["error"], rel=0.05) and a["times_floor"] < 1.5
    assert "% of the rows repeat the angles of an earlier one" in one["notes"][0]


def test_an_arm_that_stands_or_has_coarse_encoders_repeats_genuine_readings():
    time = np.arange(3000) / 100.0
    stands = np.where(np.sin(time) > 0.0, 0.5, 0.0)[:, None] * np.ones(2)  # and steps
    slow = np.round(0.02 * np.stack([np.sin(time), np.cos(time)], 1) / 1.5e-3) * 1.5e-3
    for values in (stands, slow):
        assert not held(time, values, np.ones(2999, bool)).any()
    once = np.r_[0.5 * np.linspace(0.0, 1.0, 500) ** 2, np.full(500, 0.5)]  # goes, then stands
    twice, clock = np.tile(once, 2)[:, None] * np.ones(2), np.tile(np.arange(1000) / 100.0, 2)
    assert not held(clock, twice, np.diff(clock) > 0).any()


def test_honest_motion_has_no_bad_readings():
    rng = np.random.default_rng(5)
    time = np.arange(6000) / 50.0  # a slow log of a fast servo: steps, sharp turns, a coarse encoder
    steps = np.where(np.sin(time) > 0, 1.0, -1.0)
    turns = np.abs((3.0 * time) % 2.0 - 1.0)
    bounce = np.abs(np.sin(4 * time))
    for q in (steps, turns, bounce):
        coarse = np.round(q / 1.53e-3) * 1.53e-3
        for values in (q, coarse, q + rng.normal(scale=1e-3, size=q.shape)):
            assert spikes(time, values) == ()


def test_a_unit_that_cannot_be_true_is_said():
    limits = Limits(np.full((2, 2), [-3.0, 3.0]), np.full(2, 5.0), np.full(2, 100.0))
    slow = replace(moving(time=np.arange(5000) * 2.0), rate_hz=0.5)
    assert any("a unit is wrong, likely ms where s was taken" in line for line in check(slow, limits).warnings)


def test_the_tracking_error_is_told_in_degrees(tmp_path, capsys):
    rec = moving(q_cmd=moving(noise_q=0.0).q + np.deg2rad([3.0, 0.5]))
    rec.q_cmd[100, 1] += np.deg2rad(4.0)
    a, b = check(rec).joints
    assert np.degrees(a.tracking_rms) == pytest.approx(3.0, rel=0.01)
    assert np.degrees(b.tracking_worst) == pytest.approx(4.5, rel=0.01)
    assert typed("check", write(rec, tmp_path / "rig")) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "deg RMS" in printed and "3.00 3.00" in printed and "0.50 4.50" in printed
    assert "joint1: is off its command by 3.0 degrees RMS" in printed and "joint2: is off" not in printed
    assert check(replace(rec, q_cmd=None)).joints[0].tracking_rms is None


@pytest.mark.parametrize("rows", [2, 3, 4, 11])
def test_a_handful_of_samples_is_checked_like_any(rows):
    full = moving(noise_q=0.0)
    short = {name: getattr(full, name)[:rows] for name in ("time", "q", "dq", "tau", "q_cmd", "dq_cmd")
             if getattr(full, name) is not None}  # fmt: skip
    assert timing(replace(full, **short)).repeated == 0
    assert check(replace(full, **short)).timing.duration_s == pytest.approx((rows - 1) / RATE)


@pytest.mark.parametrize("step", [2 * np.pi / 2**14, 2 * np.pi / 2**17, 1e-3])
@pytest.mark.parametrize("offset", [0.0, 0.123456])
def test_an_encoders_step_is_recovered(step, offset):
    q = moving(noise_q=0.0).q[:, 1]
    assert quantization(np.round(q / step) * step + offset) == pytest.approx(step, rel=1e-3)


def test_what_is_not_quantized_has_no_step():
    rec = moving()
    assert quantization(rec.q[:, 0]) is None and quantization(rec.tau[:, 0]) is None
    assert quantization(np.round(rec.q[:, 0], 9)) is None  # digits of the file, not of a sensor
    assert quantization(np.zeros(100)) is None


@pytest.mark.parametrize("sigma", [1e-5, 1e-3])
def test_noise_is_recovered_from_one_recording(sigma):
    rec = moving(noise_q=sigma, noise_tau=0.3)
    assert highpass_sigma(rec.q) == pytest.approx([sigma, sigma], rel=0.06)
    assert highpass_sigma(rec.tau) == pytest.approx([0.3, 0.3], rel=0.06)


def test_readings_that_are_missing_show_no_noise_and_draw_no_warning():
    """Of a joint without readings, of a recording of four rows, and where no five readings follow each other."""
    noise = np.random.default_rng(0).normal(scale=0.1, size=(400, 3))
    noise[:, 1], noise[::3, 2] = np.nan, np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        assert highpass_sigma(noise) == pytest.approx([0.1, 0.0, 0.0], rel=0.2)
        assert not highpass_sigma(noise[:4]).any()


@pytest.mark.parametrize("missing", ["tau.joint5", "dq.joint3", "tau"])
def test_a_channel_without_readings_is_checked_and_compared_without_numpys_warnings(missing, tmp_path):
    rec = vispeg.load_recording(assets() / "recordings" / "rig-a", seconds=3)
    signal, _, joint = missing.partition(".")
    values = np.array(getattr(rec, signal))
    values[:, rec.joints.index(joint) if joint else slice(None)] = np.nan
    rec = replace(rec, **{signal: values})
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        assert vispeg.compare("iiwa14", rec, threads=1).error > 0
        assert vispeg.check(write(rec, tmp_path / "rig")).reports


def test_noise_is_recovered_from_repeats_and_other_motions_are_refused():
    recs = [moving(seed=s, noise_q=3e-4) for s in range(3)]
    shared = np.sin(np.arange(5000) / 50)[:, None]  # an effect that every run shows is no noise
    for rec in recs:
        rec.q[:] += 0.01 * shared
    assert noise_from_repeats(recs) == pytest.approx([3e-4, 3e-4], rel=0.03)
    other = moving(q_cmd=moving().q_cmd + 0.1)
    with pytest.raises(UserError, match="repeat"):
        noise_from_repeats([recs[0], other])
    with pytest.raises(UserError, match="two"):
        noise_from_repeats(recs[:1])


def test_clipping_is_found_and_a_peak_is_none():
    time = np.arange(5000) / RATE
    smooth = 100 * np.sin(2 * np.pi * 0.5 * time)
    clipped = np.clip(smooth, -200, 60)
    assert np.array_equal(saturated(clipped, 1 / RATE), clipped == 60)
    assert not saturated(smooth, 1 / RATE).any()
    assert not saturated(np.round(smooth), 1 / RATE).any()  # flat peaks of a quantized signal
    assert not saturated(np.zeros(100), 1 / RATE).any()
    noisy = clipped + np.random.default_rng(3).normal(scale=0.05, size=time.size)
    assert saturated(noisy, 1 / RATE, limit=60.0)[clipped == 60].mean() > 0.99
    assert not saturated(noisy, 1 / RATE, limit=120.0).any()


def test_limits_are_held_against_the_motion():
    rec = moving()
    limits = Limits(np.array([[-0.5, 0.5], [-3, 3]]), np.array([9.0, 0.5]), np.array([15.0, 99.0]))
    a, b = check(rec, limits).joints
    assert a.outside_range == pytest.approx(np.sum(np.abs(rec.q[:, 0]) > 0.501), abs=2)
    assert a.over_torque == np.sum(np.abs(rec.tau[:, 0]) > 15.3) and a.over_velocity == 0
    assert (b.outside_range, b.over_torque) == (0, 0) and b.over_velocity > 100


def test_stated_noise_that_is_not_there_is_mentioned():
    lines = check(moving(noise={"q": 1e-3, "tau": 0.2})).warnings
    assert len(lines) == 2 and all("noise of q" in line for line in lines)
    assert any("every joint shows no sensor noise" in line for line in check(moving(noise_q=0.0, noise={})).warnings)


def motion_of(q, time):
    dq = np.gradient(q, time)
    return q, dq, np.gradient(dq, time)


def test_the_promised_precision_is_what_least_squares_delivers():
    time = np.arange(4000) / RATE
    motion = motion_of(np.sin(2 * time) + 0.5 * np.sin(3.1 * time), time)
    promised = excitation(*motion, noise_tau=0.2).sigma
    columns = regressor(*motion)
    noise = np.random.default_rng(4).normal(scale=0.2, size=(len(time), 400))
    scatter = np.linalg.lstsq(columns, noise, rcond=None)[0].std(axis=1)
    assert promised is not None
    assert [promised[name] for name in PARAMETERS] == pytest.approx(scatter, rel=0.15)


def test_poor_motions_are_told_from_good_ones():
    time = np.arange(4000) / RATE
    rich = excitation(*motion_of(np.sin(2 * time) + 0.5 * np.sin(3.1 * time), time))
    steady = excitation(*motion_of(0.3 * time, time))  # one speed, one direction
    tiny = excitation(*motion_of(1e-3 * np.sin(2 * time), time))
    still = excitation(*motion_of(np.zeros(4000), time))
    assert min(rich.identifiability.values()) > 0.05 and rich.condition < 100
    assert max(steady.identifiability[k] for k in ("coulomb", "viscous", "bias")) < 1e-6 and steady.reversals == 0
    assert tiny.identifiability["gravity_cos"] < 1e-3  # cos q is the bias where q hardly moves
    assert still.condition is None and set(still.identifiability.values()) == {0.0}


def test_what_one_speed_confounds_leaves_gravity_and_bias_determined():
    """There and back at one speed: dry friction is viscous friction, nothing accelerates, the rest is regular."""
    q = np.concatenate([ramp := np.linspace(-1.0, 1.0, 500), ramp[::-1]])
    dq = np.repeat([1.0, -1.0], 500)
    found = excitation(q, dq, np.zeros(1000), noise_tau=0.2)
    regular = np.stack([np.sign(dq), np.sin(q), np.cos(q), np.ones(1000)], axis=1)
    sigma = dict(
        zip(("coulomb", *PARAMETERS[3:]), 0.2 * np.sqrt(np.diag(np.linalg.inv(regular.T @ regular))), strict=True)
    )
    assert found.sigma is not None and found.condition == np.inf
    confounded = PARAMETERS[:3]
    assert [(found.identifiability[k], found.sigma[k]) for k in confounded] == [(0.0, np.inf)] * 3
    for name in PARAMETERS[3:]:
        assert found.identifiability[name] > 0.1 and found.sigma[name] == pytest.approx(sigma[name])


def test_reversals_are_counted_through_noise():
    time = np.arange(5000) / RATE  # 10 s: ten half-waves of a 0.5 Hz sine, ten turning points
    assert check(moving()).joints[0].excitation.reversals == 10
    assert excitation(*motion_of(np.sin(time), time)).reversals == 3


def test_the_command_writes_what_it_prints(tmp_path, capsys):
    robot = tmp_path / "rig"
    write(moving(time=np.concatenate([np.arange(2500), np.arange(2505, 5005)]) / RATE), robot)
    assert typed("check", robot, out=tmp_path / "out", json=True) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "out" / "check.json").read_text())
    assert printed["recordings"][0]["timing"]["gaps"][0]["samples"] == 5
    assert (tmp_path / "out" / "check.png").read_bytes().startswith(b"\x89PNG")
    assert typed("check", robot, write(moving(seed=5), tmp_path / "again")) == 0
    printed = capsys.readouterr().out
    assert "1 gap, 5 samples lost" in " ".join(printed.split())
    for head in ("lowest", "top speed", "reversals", "off its command", "largest torque", "dry friction known to"):
        assert head in printed, head
    assert all(len(line) <= 80 for line in printed.splitlines() if line.startswith(" ") and "!" not in line)
    with pytest.raises(UserError, match="exists"):
        typed("check", robot, out=tmp_path / "out")


def test_a_recording_given_twice_is_no_repeat(tmp_path):
    folder = write(moving(), tmp_path / "rig")
    with pytest.raises(UserError, match="given twice"):
        typed("check", folder, tmp_path / "other" / ".." / "rig")


def test_a_joint_that_the_robot_does_not_have(tmp_path):
    folder = write(moving(joints=("joint1", "joint9")), tmp_path / "rig")
    with pytest.raises(UserError, match="joint9.*choices: joint1"):
        typed("check", folder)


def test_what_a_motion_needs_is_mujoco_s_inverse_dynamics_in_the_order_of_the_log(monkeypatch):
    """In blocks, of which the last is shorter."""
    rec = moving(50, joints=("joint3", "joint1", "joint2"))
    robot = load_for(rec.joints, rec.robot)
    monkeypatch.setattr("vispeg.sim.inverse_dynamics.BATCH", 20)
    motion = np.random.default_rng(0).normal(size=(3, 50, 3))
    model = robot.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, expected = mujoco.MjData(model), []
    for state in np.swapaxes(motion, 0, 1):
        for joint, (q, dq, ddq) in zip(rec.joints, state.T, strict=True):
            one = data.joint(joint)
            one.qpos, one.qvel, one.qacc = q, dq, ddq
        mujoco.mj_inverse(model, data)
        expected.append([data.joint(joint).qfrc_inverse[0] for joint in rec.joints])
    needs = needs_of(robot, rec)
    for _ in range(2):
        np.testing.assert_allclose(needs(*motion), expected, rtol=1e-9, atol=1e-9)


def test_check_doubts_what_a_comparison_doubts_where_the_log_lacks_joints(tmp_path):
    """Torques by the model's own inverse dynamics, the other joints at rest, in kN m taken for N m."""
    rec = moving(3000, joints=("joint1", "joint2"))
    rate = np.gradient(rec.q_cmd, rec.time, axis=0)
    needs = needs_of(load_for(rec.joints, rec.robot), rec)
    tau = 1e-3 * needs(rec.q_cmd, rate, np.gradient(rate, rec.time, axis=0))
    rec = replace(rec, tau=tau)
    with pytest.warns(UserWarning, match="torques are 0.001 times what the model needs"):
        check_units(rec)
    write(rec, tmp_path / "rec")
    warned = vispeg.check(tmp_path / "rec").reports[0].warnings
    assert any("torques are 0.001 times what the model needs" in line for line in warned), warned
