"""Loops that a saturated drive leaves open are compared like torque control; stops that were passed are none."""

from __future__ import annotations

import os
import warnings
from dataclasses import replace

import numpy as np
import pytest
from loops import ARM, iiwa_segment, recorded

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.identify.evidence import Evidence
from vispeg.identify.loops.opened import _asked, saturated, torque_if_saturated
from vispeg.identify.loops.stops import passed, without_stops
from vispeg.identify.nominal import nominal_robot, robot_of
from vispeg.robots.model import load
from vispeg.worlds.world import World

ROBOT = load("iiwa14")


def run(limit: float):
    world = World().add(EffectInstance.of("torque_limit", "joint4", limit=limit))
    return world, recorded(ROBOT, "iiwa14", world, iiwa_segment("position", 3.0, seed=3), stream(3, "opened"))


def test_a_drive_that_gives_what_it_is_asked_for_keeps_its_loop():
    _, rec = run(1000.0)
    assert not saturated(rec, ROBOT).any()
    assert torque_if_saturated(rec, ROBOT) is rec


def test_friction_is_no_saturation():
    """It too makes a loop ask for more than the motion needs, but what the joint gets follows the motion."""
    world = World().add(EffectInstance.of("coulomb_friction", "joint7", torque=0.15))
    rec = recorded(ROBOT, "iiwa14", world, iiwa_segment("position", 3.0, seed=3), stream(3, "dry"))
    assert not saturated(rec, ROBOT).any()


def test_the_right_model_of_an_open_loop_stands_at_the_noise_floor():
    world, rec = run(14.0)
    assert list(np.flatnonzero(saturated(rec, ROBOT))) == [3]
    evidence = Evidence([rec])
    assert evidence.recordings[0].control.mode == "torque"
    assert any("saturated" in note for note in evidence.notes)
    (residual,) = evidence.residuals([world])
    assert np.sum(residual**2) / evidence.count == pytest.approx(1.0, abs=0.3)
    assert torque_if_saturated(evidence.recordings[0], ROBOT) is evidence.recordings[0]


def test_a_drive_whose_limit_the_motion_passes_at_times_is_saturated_too():
    """Its torque varies by a quarter of its mean; in a closed loop the right model would be 3000 variances away."""
    world, rec = run(18.0)
    assert list(np.flatnonzero(saturated(rec, ROBOT))) == [3]
    evidence = Evidence([rec])
    (residual,) = evidence.residuals([world])
    assert np.sum(residual**2) / evidence.count < 100.0


def test_an_episode_asks_for_the_torques_that_it_asks_for_alone():
    """The clock runs on, and between the episodes the arm was moved by 0.9 rad: no speed of the loop."""
    _, a = run(14.0)
    b = replace(a, time=a.time + a.time[-1] + 2e-3, q=a.q + 0.9, q_cmd=a.q_cmd + 0.9)
    both = {k: np.concatenate([getattr(a, k), getattr(b, k)]) for k in ("time", "q", "q_cmd", "dq_cmd", "tau")}
    joined = replace(a, episode=np.repeat([0, 1], len(a.time)), **both)
    np.testing.assert_allclose(_asked(joined), np.concatenate([_asked(a), _asked(b)]), atol=1e-9)
    cut = replace(joined, episode=np.repeat([0, 1, 2], [len(a.time), len(a.time) - 1, 1]))
    assert np.isfinite(_asked(cut)).all(), "the last episode is a single sample"


def test_a_stop_that_was_passed_is_left_out():
    _, rec = run(1000.0)
    low, high = ROBOT.range[3]
    beyond = replace(rec, q=np.where(np.arange(7) == 3, high + 2 * RULES.beyond_stop, rec.q))
    assert passed(ROBOT, rec.q) == () and passed(ROBOT, beyond.q) == ("joint4",)
    assert without_stops(ROBOT, ()) is ROBOT
    free = without_stops(ROBOT, ("joint4",))
    assert list(free.compile().jnt_limited) == [True] * 3 + [False] + [True] * 3
    assert tuple(free.range[3]) == (low, high)  # motions are still planned inside it


@pytest.mark.parametrize("edited", ["arm.xml", "tool.xml"])
def test_an_edited_robot_or_gripper_is_read_again_for_a_recording(edited, tmp_path):
    """With one joint beyond its stop, and a second one held at rest, which the recording lacks and one note names."""
    arm, tool = tmp_path / "arm.xml", tmp_path / "tool.xml"
    arm.write_text(ARM.replace('name="shoulder"', 'name="shoulder" range="-1 1"'))
    body = '<body><geom size=".02" mass="2"/><site name="grasp" pos="0 0 .1"/></body>'
    tool.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    _, rec = run(1000.0)
    rec = replace(rec, robot=str(arm), tool=str(tool), joints=("shoulder",), q=np.full((len(rec.q), 1), 1.5))
    with warnings.catch_warnings(record=True) as said:
        first, free = nominal_robot(rec), robot_of(rec)
        with warnings.catch_warnings():
            assert nominal_robot(rec) is first and robot_of(rec) is free
        assert len(said) == 1 and "elbow" in str(said[0].message)
        (tmp_path / edited).write_text((tmp_path / edited).read_text().replace('mass="2"', 'mass="3"'))
        os.utime(tmp_path / edited, ns=(1, 1))
        for before, now in ((first, nominal_robot(rec)), (free, robot_of(rec))):
            assert now.compile().body_mass.sum() - before.compile().body_mass.sum() == pytest.approx(1.0)
        assert first.compile().jnt_limited[0] and not robot_of(rec).compile().jnt_limited[0]
