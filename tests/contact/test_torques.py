"""Contact from joint torques alone: the wrench is the true one within what is stated, and so is what it tells."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vispeg.contact.run import evidence_of
from vispeg.contact.selection.likely import intervals
from vispeg.contact.selection.profile import places
from vispeg.contact.torques import calm
from vispeg.contact.touch import has_wrench, touches
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.identify.fit import fit_job
from vispeg.identify.pool import run_together
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.noise import NOISE
from vispeg.recordings.recording import Control, Recording
from vispeg.recordings.regimes import FREE
from vispeg.robots.tools import CELL
from vispeg.sim.external import BLOCK, PRIOR, External, _steady, external, flange_jacobian, solved
from vispeg.sim.touch import touch
from vispeg.task.belief import believed
from vispeg.task.rig.commanded import CellMotion
from vispeg.task.rig.motions import Place, press
from vispeg.task.rig.path import commands
from vispeg.task.rig.record import record_cell
from vispeg.task.start import home
from vispeg.worlds.world import World

MODEL = World("iiwa14", CELL, cell=CellBelief("nominal"))
FOUND = believed(MODEL.cell)
SOFT = 1e-4  # m/N, of the hidden fixture


@pytest.fixture(scope="module")
def pressed():
    """One press of 5 to 25 N on a soft fixture, with a wrench sensor and joint torques."""
    time, frames = press(Place(FOUND.scene, stream(1, "torques")), 1).frames(500.0)
    made = CellMotion("press", time, commands(frames, FOUND.scene, FOUND.config.stiffness))
    hidden = EffectInstance.of("fixture_compliance", "fixture", z=SOFT)
    return record_cell(MODEL.add(hidden), made, NOISE, stream(2, "torques"))


def numb(rec, friction=0.0):
    """Without its wrench sensor; joints rub by so many N m where the torque sensors see it."""
    noise = {k: v for k, v in rec.noise.items() if not k.startswith("ft")}
    tau = rec.tau + friction * np.tanh(rec.dq / 0.01)
    return replace(rec, ft=None, wrench=None, noise=noise, tau=tau)


@pytest.mark.parametrize("friction", [0.0, 0.3, 1.0])
def test_the_wrench_from_torques_is_the_true_one_within_what_is_stated(friction, pressed):
    """Per axis and regime, RMS error of block means over the stated sigma; with friction that is far from nothing."""
    found = external(numb(pressed, friction), FOUND.scene.nominal)
    size = round(BLOCK * pressed.rate_hz)
    m = len(pressed.time) // size
    off = (found.wrench - pressed.ft)[: m * size].reshape(m, size, 6).mean(axis=1)
    white = (found.gain[: m * size : size] ** 2 @ found.white**2) / size
    sigma = np.sqrt(found.sigma[: m * size : size] ** 2 + white)
    regime = touch(pressed, FOUND.scene).regime[size // 2 : m * size : size]
    for some in (regime == FREE, regime != FREE):
        score = np.sqrt(np.mean((off[some] / sigma[some]) ** 2, axis=0))
        assert np.all(score < 1.5) and np.sqrt(np.mean(score**2)) < 1.2
    pushed = np.linalg.norm(found.wrench[:, :3], axis=1).max()
    assert pushed == pytest.approx(np.linalg.norm(pressed.ft[:, :3], axis=1).max(), rel=0.1)
    assert np.sqrt(np.mean(sigma[:, :3] ** 2)) < 0.6 + 3.0 * friction, "and the stated sigma is of use"


@pytest.mark.parametrize("column", ["tau", "q"])
def test_missing_readings_push_nothing_and_a_long_gap_is_left_open(column, pressed):
    """Two samples of one joint are bridged; a tenth of a second is not, but its neighbours stay as they are."""
    rec, found = numb(pressed), external(numb(pressed), FOUND.scene.nominal)
    short, long = slice(300, 302), slice(600, 650)
    values = getattr(rec, column).copy()
    values[short, 3] = values[long, 3] = np.nan
    holed = external(replace(rec, **{column: values}), FOUND.scene.nominal)
    assert np.isnan(holed.wrench[long]).all() and np.isfinite(np.delete(holed.wrench, np.arange(600, 650), 0)).all()
    force = np.abs(holed.wrench - found.wrench)[:, :3]
    assert force[250:350].max() < 0.5 and np.nanmax(force) < 2.0, "N"
    np.testing.assert_allclose(holed.steady, found.steady, rtol=0.1)


def twice(rec: Recording, second: float) -> Recording:
    """Two episodes of the same samples, the second from so many seconds on; its forces (N) have another zero."""
    both = {k: np.concatenate([v, v]) for k in ("q", "dq", "tau", "ft", "ee_cmd") if (v := getattr(rec, k)) is not None}
    both["ft"][len(rec.time) :, :3] += 5.0
    episode = np.repeat([0, 1], len(rec.time))
    return replace(rec, time=np.concatenate([rec.time, rec.time + second]), episode=episode, **both)


def test_a_clock_that_runs_on_between_episodes_changes_nothing(pressed):
    """Each episode has its own zero and its own start at rest, whether or not time steps back there."""
    one, on = twice(pressed, 0.0), twice(pressed, pressed.time[-1] + 0.002)
    np.testing.assert_array_equal(touch(on, FOUND.scene).regime, touch(one, FOUND.scene).regime)
    found = [external(rec, FOUND.scene.nominal) for rec in (one, on)]
    np.testing.assert_allclose(found[1].wrench, found[0].wrench, atol=0.02)
    np.testing.assert_allclose(found[1].steady, found[0].steady, rtol=0.1)  # a block may begin one sample later
    noise = [calm(rec, estimate).noise for rec, estimate in zip((one, on), found, strict=True)]
    assert noise[1] == pytest.approx(noise[0], rel=0.01)


def test_torques_that_begin_after_the_rest_at_the_start_are_refused_in_a_line(pressed):
    rec = numb(pressed)
    late = np.where((rec.time < rec.time[0] + 0.6)[:, None], np.nan, rec.tau)
    with pytest.raises(UserError, match="no joint torques at the start"):
        evidence_of([replace(rec, tau=late)])


@pytest.mark.parametrize("zeros", [(0.0,), (0.0, 5.0), (3.0, -1.0, 2.0)])
def test_the_noise_of_several_episodes_is_that_within_each(zeros):
    """Each episode has its own zero (N), which is no noise."""
    n, rng = 300, stream(5, "zeros")
    time = np.tile(np.arange(n) / 500.0, len(zeros))
    sigma = np.repeat([0.02, 0.001], 3)
    wrench = np.repeat(zeros, n)[:, None] + sigma * rng.standard_normal((len(time), 6))
    q = np.zeros((len(time), 7))
    rec = Recording(Path("made"), "iiwa14", FOUND.scene.joints, 500.0, Control(), time, q, tau=q)
    none = np.zeros((len(time), 6, 7)), np.zeros(7), np.zeros(7), np.zeros((len(time), 6, 6))
    noise = calm(rec, External(wrench, *none)).noise
    assert noise["ft"] == pytest.approx(0.02, rel=0.1) and noise["ft_torque"] == pytest.approx(0.001, rel=0.1)


def test_what_a_straight_arm_does_not_see_is_said_and_as_unsure_as_any_wrench():
    """Stretched out upwards, no joint torque tells a push along the arm; the direction is the Jacobian's own."""
    jac = flange_jacobian(FOUND.scene.nominal, np.array([np.zeros(7), home(FOUND.scene)]))
    gain, blind = solved(jac, np.full(7, 0.2))
    lengths = np.linalg.norm(blind / PRIOR[:, None], axis=1)
    assert np.all(lengths[1] == 0) and np.isfinite(gain).all()
    value, vector = np.linalg.svd(jac[0] * PRIOR[:, None])[1::-1]
    null = vector[:, value < 1e-6 * value[0]]
    unseen = np.linalg.qr((blind[0] / PRIOR[:, None])[:, lengths[0] > 0])[0]
    assert null.shape[1] == unseen.shape[1] == 3, "joints turn in one plane, and about the arm"
    np.testing.assert_allclose(unseen @ (unseen.T @ null), null, atol=1e-6)
    wrench = np.array([4.0, -3.0, 8.0, 0.3, 0.2, -0.1])
    np.testing.assert_allclose(gain[1] @ (jac[1].T @ wrench), wrench, rtol=5e-3, atol=5e-3)
    seen = np.eye(6) - unseen @ unseen.T
    np.testing.assert_allclose(gain[0] @ (jac[0].T @ wrench) / PRIOR, seen @ (wrench / PRIOR), atol=1e-3)


def fitted(rec):
    """Evidence of a recording, and the interval of the fixture's compliance in z."""
    evidence = evidence_of([rec])
    start = World().add(EffectInstance.of("fixture_compliance", "fixture", z=4e-5))
    evidence.absent = {("fixture_compliance", k) for k in ("x", "y", "roll", "pitch")}
    (fit,) = run_together([fit_job(evidence, start, [0], iterations=6)], evidence.residuals)
    return evidence, intervals(evidence, fit)[0].effects[0].params["z"]


@pytest.mark.slow
def test_a_soft_fixture_is_told_from_torques_alone_less_surely_than_by_a_sensor(pressed):
    evidence, told = fitted(numb(pressed))
    _, read = fitted(pressed)
    for value in (told, read):
        assert value.low <= SOFT <= value.high and value.low > 0.3 * SOFT
    assert told.high - told.low > read.high - read.low
    assert "no force sensor" in evidence.notes[0] and "intervals are wider" in evidence.notes[0]
    offered = {name for name, _ in places(evidence, World())}
    assert "fixture_compliance" in offered and not any(effect(n).overrides("wrench") for n in offered)


def test_what_touches_without_wrench_and_torques_is_refused_in_one_line(pressed):
    rec = numb(pressed)
    deaf = replace(rec, tau=None, torque_sensor="none")
    with pytest.raises(UserError, match="nor joint torques") as refused:
        has_wrench([deaf])
    assert "\n" not in str(refused.value) and "recording.yaml" in str(refused.value)
    air = replace(deaf, **{k: getattr(deaf, k)[:400] for k in ("time", "q", "dq", "ee", "ee_cmd")})
    assert touches(rec, FOUND.scene) and not touches(air, FOUND.scene)
    assert has_wrench([pressed]) and has_wrench([rec]) and not has_wrench([air])


@pytest.mark.parametrize("joints", [6, 7])
@pytest.mark.parametrize("seconds", [0.3, 3.0])
def test_steady_torque_errors_are_finite_for_six_joints_and_for_a_short_episode(joints, seconds):
    """No combination of six joints' torques is free of a wrench; an episode shorter than its rest leaves the sensor."""
    rng, n = stream(4, "steady"), round(100 * seconds)
    names = tuple(f"joint{k + 1}" for k in range(joints))
    still, tau = np.zeros((n, joints)), rng.normal(0.0, 10.0, (n, joints))
    rec = Recording(Path("made"), "arm", names, 100.0, Control(), np.arange(n) / 100.0, still, tau=tau)
    off = _steady(rec, rng.normal(0.0, 0.1, (n, joints)), rng.normal(0.0, 1.0, (n, 6, joints)), np.full(joints, 0.1))
    assert off.shape == (joints,) and np.all(np.isfinite(off)) and np.all(off > 0)
