"""Encoders that read in steps are told by their readings alone, in steps that no squared error shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.readings import gridded
from vispeg.diagnosis.record import with_origin
from vispeg.diagnosis.run import diagnose
from vispeg.identify.excitation import motion
from vispeg.identify.record import centre_of, controller, record
from vispeg.recordings.recording import Recording
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled
from vispeg.worlds.world import World

FRICTION = EffectInstance.of("coulomb_friction", "joint4", torque=1.0)
NOISE = {"q": 2e-5, "dq": 1e-3, "tau": 0.2}
STEP = 1.6e-4  # rad, 8 sigma


@pytest.fixture(scope="module")
def recordings():
    """Three recordings of the nominal arm under position control, 1.5 s each."""
    robot, out = load("iiwa14"), []
    for k in range(3):
        path = motion("fourier", robot, 500.0, 1.5, stream(k, "readings"))
        control = controller(robot, "position", 500.0, centre_of(robot))
        out.append(record(World(), path, control, NOISE, stream(k, "readings noise")))
    return out


def rounded(recs: list[Recording], zero: float = 0.0, **steps: float) -> list[Recording]:
    """As encoders with these steps (joint -> rad) read them, their grid `zero` steps off the joint's zero."""
    out = []
    for rec in recs:
        q = rec.q.copy()
        for joint, step in steps.items():
            j = rec.joints.index(joint)
            q[:, j] = step * (np.round(q[:, j] / step - zero) + zero)
        out.append(replace(rec, q=q))
    return out


def test_the_step_is_read_off_with_its_interval(recordings):
    read = gridded(World(), rounded(recordings, joint3=STEP, joint6=3 * STEP))
    assert [e.label for e in read] == ["encoder_quantization(joint3)", "encoder_quantization(joint6)"]
    for placed, true in zip(read, (STEP, 3 * STEP), strict=True):
        step = placed.params["step"]
        assert step.value == pytest.approx(true, rel=1e-6)
        assert step.low < true < step.high < step.low * 1.001


def test_one_step_in_all_joints_is_one_effect(recordings):
    (placed,) = gridded(World(), rounded(recordings, **dict.fromkeys(recordings[0].joints, STEP)))
    assert placed.where == "all" and placed.params["step"].value == pytest.approx(STEP, rel=1e-6)


def test_steps_that_are_multiples_of_one_another_stay_apart(recordings):
    """Encoders that differ by a bit: readings of the coarse ones lie on the grid of the fine ones, too."""
    steps = {j: STEP * (2 if k > 3 else 1) for k, j in enumerate(recordings[0].joints)}
    read = gridded(World(), rounded(recordings, **steps))
    assert {e.where: e.params["step"].value for e in read} == pytest.approx(steps, rel=1e-6)


def test_joints_at_rest_have_no_say_and_unlike_steps_stay_apart(recordings):
    joints = recordings[0].joints
    coarse = rounded(recordings, **dict.fromkeys(joints, STEP))
    for rec in coarse:
        rec.q[:, 6] = rec.q[0, 6]
        rec.q[10:20, 2] = np.nan
    (placed,) = gridded(World(), coarse)
    assert placed.where == "all"
    unlike = gridded(World(), rounded(recordings, **{j: STEP * (1.005 if j == "joint2" else 1.0) for j in joints}))
    assert tuple(e.where for e in unlike) == joints
    assert unlike[1].params["step"].value == pytest.approx(1.005 * STEP, rel=1e-6)


def test_nothing_is_read_off_what_has_no_step_of_its_own(recordings):
    known = World().add(EffectInstance.of("encoder_quantization", "joint3", step=STEP))
    coarse, fine = rounded(recordings, joint3=STEP), rounded(recordings, joint3=2e-6)
    assert gridded(World(), recordings) == ()
    assert gridded(World(), fine) == (), "a log's last decimal"
    assert gridded(known, coarse) == ()
    assert gridded(World(), [*coarse[:2], recordings[2]]) == (), "one recording has no step"
    assert gridded(World(), [*coarse[:2], *rounded(recordings[2:], joint3=1.2 * STEP)]) == ()
    assert gridded(World(), rounded(recordings, 0.5, joint3=30 * NOISE["q"])) == (), "the effect's grid is elsewhere"
    rough = [replace(r, noise={**NOISE, "q": 0.3 * STEP}) for r in coarse]
    assert gridded(World(), rough) == (), "the stated noise is that of the rounding"


@pytest.mark.slow
def test_a_diagnosis_names_the_joint_that_reads_in_steps(recordings):
    first, second, third = rounded(recordings, joint3=STEP)
    found = diagnose(World(), [first, second], [third], plan_next=False)
    record = found.record
    assert record["verdict"] == "identified"
    assert [(e["effect"], e["where"]) for e in record["effects"]] == [("encoder_quantization", "joint3")]
    assert [rung["model"] for rung in record["ladder"]] == ["nominal", "+ encoder_quantization(joint3)"]
    assert not any("joint3 is read in steps" in note for note in record["notes"])
    assert "fell" not in record["reason"], "the steps leave as much as no steps do"
    (placed,) = found.world.effects
    assert placed.origin is not None and placed.params["step"].value == pytest.approx(STEP, rel=1e-6)


@pytest.mark.parametrize("mode", ["position", "torque", "osc", "servo"])
def test_a_recorded_encoder_rounds_its_noise_too_and_every_run_has_its_own(mode):
    """As a real one does: readings lie on its grid, near the true angle, and flip where noise tips them."""
    robot = load("iiwa14")
    control = controller(robot, mode, 500.0, centre_of(robot))
    more = {"model": compiled(robot)} if mode == "osc" else {}
    path = motion("osc" if mode == "osc" else "fourier", robot, 500.0, 1.0, stream(1, "readings"), **more)
    coarse = World().add(EffectInstance.of("encoder_quantization", "joint3", step=STEP))
    runs = record(coarse, path, control, NOISE, stream(2, "readings noise"), repeat=2)
    first, second = (runs.q[runs.episode == k] for k in (0, 1))
    steps = first[:, 2] / STEP
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert runs.noise["q"] == NOISE["q"]
    tipped = np.mean(np.abs(first[:, 2] - second[:, 2]) > 0.5 * STEP)
    assert 0.05 < tipped < 0.9
    np.testing.assert_allclose(np.std(first[:, 0] - second[:, 0]), np.sqrt(2) * NOISE["q"], rtol=0.5)


def test_an_encoder_with_no_step_changes_no_recording():
    robot = load("iiwa14")
    control = controller(robot, "position", 500.0, centre_of(robot))
    path = motion("fourier", robot, 500.0, 0.2, stream(1, "readings"))
    null = World().add(EffectInstance.of("encoder_quantization", "joint3", step=0.0))
    plain, same = (record(w, path, control, NOISE, stream(2, "readings noise")) for w in (World(), null))
    np.testing.assert_array_equal(plain.q, same.q)


def test_a_step_that_was_read_stays_as_it_is_where_a_model_is_partial():
    world = World().add(EffectInstance.of("encoder_quantization", "joint3", step=STEP), FRICTION)
    marked = with_origin(world, 0, [], [], 1.0, 0.5, partial=True)
    assert [e.partial for e in marked.effects] == [False, True]
