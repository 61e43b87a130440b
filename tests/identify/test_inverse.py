"""Evidence in torque space against MuJoCo's own inverse dynamics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from loops import ARM, SWING, iiwa_segment, pendulum, recorded

from vispeg.channels.channel import CHANNELS, How
from vispeg.core.effect import EffectInstance, searchable
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.identify.fit import fit_job
from vispeg.identify.inverse import TorqueEvidence, evidence_for
from vispeg.identify.pool import run_together
from vispeg.recordings.differentiate import smooth
from vispeg.recordings.recording import Control, Recording
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled
from vispeg.sim.external import needed
from vispeg.worlds.world import World

REGISTRY = searchable()  # what an arm alone can show

ROBOT = load("iiwa14")


def passively(world: World, seed: int = 0, seconds: float = 3.0):
    """A recording that says nothing of its controller."""
    rec = recorded(ROBOT, "iiwa14", world, iiwa_segment("position", seconds, seed=seed), stream(seed, "torque"))
    return replace(rec, control=Control("unknown", rec.rate_hz), q_cmd=None, dq_cmd=None)


@pytest.fixture(scope="module")
def evidence():
    return evidence_for([passively(World(), s) for s in (0, 1)])


def accelerations(item):
    return item.segment.cache["ddq"]


def test_nominal_torque_is_mujocos_inverse(evidence):
    model = ROBOT.compile()
    data = mujoco.MjData(model)
    for item, predicted in zip(evidence.items, evidence.simulated([World()]), strict=True):
        ddq = accelerations(item)
        for k in range(10, len(ddq) - 10, 13):
            data.qpos[:], data.qvel[:], data.qacc[:] = item.segment.q[k], item.segment.dq[k], ddq[k]
            mujoco.mj_inverse(model, data)
            np.testing.assert_allclose(predicted[0, k], data.qfrc_inverse, atol=1e-8)


SPRUNG = ARM.replace("<joint", '<joint damping="1 .7 .3" stiffness="4 3 2" springref=".5"')
TENDON = "<joint joint='shoulder' coef='1'/><joint joint='elbow' coef='-.5'/></fixed></tendon></mujoco>"
PULLED = ARM.replace("</mujoco>", "<tendon><fixed stiffness='3' damping='.4' springlength='.2'>" + TENDON)
ROPE = ARM.replace("</mujoco>", "<tendon><fixed name='rope' range='-1 1' limited='true'>" + TENDON)
WITHIN = {
    "joints": SPRUNG,
    "tendon": PULLED,
    "medium": ARM.replace("<worldbody>", '<option density="1000" viscosity="3" wind="1 0 0"/><worldbody>', 1),
}


def in_silence(folder: Path, text: str) -> TorqueEvidence:
    """Evidence of an arm of a file, whose two joints swing, without any torque."""
    (folder / "arm.xml").write_text(text)
    robot, time = load(folder / "arm.xml"), np.arange(600) / 200.0
    q = np.stack([np.sin(3.0 * time), np.cos(2.0 * time)], axis=1)
    read = {"tau": np.zeros_like(q), "torque_sensor": "motor"}
    return TorqueEvidence(
        [Recording(folder, robot.source, robot.joints, 200.0, Control("unknown", 200.0), time, q, **read)]
    )


@pytest.mark.parametrize("what", WITHIN)
def test_passive_forces_of_a_file_act_as_mujocos(what, tmp_path):
    """Springs and damping of joints (polynomials too) and tendons, and drag; also in what an arm in contact needs."""
    evidence = in_silence(tmp_path, WITHIN[what])
    (seg,), ddq = [item.segment for item in evidence.items], accelerations(evidence.items[0])
    robot = load(tmp_path / "arm.xml")
    model = robot.compile()
    data, expected = mujoco.MjData(model), np.empty_like(ddq)
    largest = 0.0
    for k in range(len(ddq)):
        data.qpos[:], data.qvel[:], data.qacc[:] = seg.q[k], seg.dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        expected[k], largest = data.qfrc_inverse, max(largest, abs(data.qfrc_passive).max())
    assert largest > 0.1 and not any("does not count" in line for line in evidence.notes)
    np.testing.assert_allclose(evidence.simulated([World()])[0][0], expected, atol=1e-8)
    np.testing.assert_allclose(needed(robot, seg.q, seg.dq, ddq), expected, atol=1e-8)


def test_what_inverse_dynamics_does_not_count_is_said(tmp_path):
    coupled = ROPE.replace("</mujoco>", "<equality><joint joint1='shoulder' joint2='elbow'/></equality></mujoco>")
    (said,) = [line for line in in_silence(tmp_path, coupled).notes if "does not count" in line]
    assert said.endswith(": coupling of shoulder and elbow, limit or friction of tendon rope")


def test_nominal_torque_is_what_the_sensor_read(evidence):
    """Measured torques less predicted ones are the sensor's noise, and little more from the differentiation."""
    for item, predicted in zip(evidence.items, evidence.simulated([World()]), strict=True):
        gap = (item.measured - predicted[0])[item.valid.all(axis=1)]
        assert np.sqrt(np.mean(gap**2)) < 0.4  # noise is 0.2 N m


@pytest.mark.parametrize("gap", [1, 20, 200], ids=lambda n: f"{n} rows")
def test_missing_angles_are_left_out_and_said(gap):
    """Beside a gap of 2, 40 or 400 ms the residual stays the sensor's noise: nothing is invented in it."""
    rec = passively(World())
    q = rec.q.copy()
    q[500 : 500 + gap, 2] = np.nan
    evidence = evidence_for([replace(rec, q=q)])
    residual = evidence.residuals([World()])[0]
    assert evidence.rms_error(residual) < 0.4 and evidence.count > 100
    (note,) = [line for line in evidence.notes if "missing" in line]
    assert "q.joint3" in note and f"at most {gap} in a row, from 1 s on" in note


@pytest.mark.parametrize(
    ("name", "where", "values", "extra"),
    [
        ("viscous_friction", "joint3", {"damping": 2.0}, lambda q, dq, ddq: 2.0 * dq[:, 2]),
        ("rotor_inertia", "joint3", {"inertia": 0.3}, lambda q, dq, ddq: 0.3 * ddq[:, 2]),
        ("cable_spring", "joint3", {"stiffness": 5.0, "reference": 0.2}, lambda q, dq, ddq: 5.0 * (q[:, 2] - 0.2)),
        ("cogging", "joint3", {"amplitude": 0.5, "poles": 9.0}, lambda q, dq, ddq: -0.5 * np.sin(9.0 * q[:, 2])),
        ("joint_bias", "joint3", {"torque": 0.7}, lambda q, dq, ddq: 0.7 + 0.0 * dq[:, 2]),
    ],
)
def test_an_effect_adds_its_own_torque_at_its_own_joint(evidence, name, where, values, extra):
    world = World().add(EffectInstance.of(name, where, **values))
    for item, y in zip(evidence.items, evidence.simulated([World(), world]), strict=True):
        s = item.segment
        change = y[1] - y[0]
        np.testing.assert_allclose(change[:, 2], extra(s.q, s.dq, accelerations(item)), atol=1e-8)
        assert not np.delete(change, 2, axis=1).any()


@pytest.mark.parametrize(
    "placed", [("torque_gain", {"gain": 1.2}), ("joint_bias", {"torque": 4.0})], ids=lambda p: p[0]
)
def test_a_motors_current_is_read_as_it_is_recorded(placed):
    """Along a recorded motion the true world needs the recorded torque of motors, as nominal motors need theirs."""
    left = []
    for world in (World(), World().add(EffectInstance.of(placed[0], "joint4", **placed[1]))):
        segment = iiwa_segment("position", 3.0, seed=0)
        rec = recorded(ROBOT, "iiwa14", world, segment, stream(0, "torque"), sensor="motor")
        rec = replace(rec, control=Control("unknown", rec.rate_hz), q_cmd=None, dq_cmd=None)
        left.append(evidence_for([rec]).errors([world, World()]))
    (right, _), (found, missed) = left
    assert found < 1.05 * right < 0.5 * missed


def test_torque_of_no_stated_sensor_is_used_nowhere():
    rec = passively(World())
    with pytest.raises(UserError, match="torque_sensor.*is none, so that no torque is used; expected joint or motor"):
        evidence_for([replace(rec, torque_sensor="none")])
    driven = recorded(ROBOT, "iiwa14", World(), iiwa_segment("position", 2.0, seed=0), stream(0, "torque"))
    assert driven.tau is not None
    for sensor, channels in (("joint", 14), ("none", 7)):
        item = evidence_for([replace(driven, torque_sensor=sensor)]).items[0]
        assert item.measured.shape[1] == channels, sensor


def test_friction_before_a_joint_torque_sensor_leaves_no_trace_which_is_said():
    """The arm of a simulated recording loses 2 N m in a drive; only the motor's torque shows it."""
    world, rms = World().add(EffectInstance.of("coulomb_friction", "joint4", torque=2.0)), {}
    for sensor in ("joint", "motor"):
        rec = recorded(ROBOT, "iiwa14", world, iiwa_segment("position", 3.0), stream(1, "felt"), sensor=sensor)
        evidence = evidence_for([replace(rec, control=Control("unknown", rec.rate_hz), q_cmd=None, dq_cmd=None)])
        (item,) = evidence.items
        rms[sensor] = np.sqrt(
            np.nanmean((evidence.simulated([World()])[0][0] - item.measured)[item.valid[:, 3], 3] ** 2)
        )
        assert any("behind the gear" in line for line in evidence.notes) == (sensor == "joint")
    assert 3.0 * rms["joint"] < rms["motor"]


def test_episodes_are_differentiated_each_on_its_own():
    a, b = passively(World(), 0), passively(World(), 1)
    both = {n: np.concatenate([getattr(a, n), getattr(b, n)]) for n in ("time", "q", "tau")}
    number = np.repeat([0, 1], [len(a.time), len(b.time)])
    whole = evidence_for([replace(a, episode=number, noise={"tau": 0.2}, **both)])
    apart = evidence_for([replace(r, noise={"tau": 0.2}) for r in (a, b)])
    assert [len(i.measured) for i in whole.items] == [len(i.measured) for i in apart.items]
    np.testing.assert_allclose(whole.residuals([World()])[0], apart.residuals([World()])[0], atol=1e-9)


def test_a_joint_without_readings_leaves_the_noise_of_two_runs_as_it_is():
    segment = iiwa_segment("position", 5.5, seed=0)
    runs = [recorded(ROBOT, "iiwa14", World(), segment, stream(k, "twice"), h_max=5e-3) for k in (0, 1)]
    runs = [replace(r, control=Control("unknown", r.rate_hz), q_cmd=None, dq_cmd=None) for r in runs]
    holed = [replace(r, tau=np.where(np.arange(7) == 6, np.nan, r.tau)) for r in runs]
    whole, part = evidence_for(runs), evidence_for(holed)
    assert whole.floor_from == part.floor_from == "repeats"
    np.testing.assert_array_equal(part.floors[:6], whole.floors[:6])
    assert part.floors[6] == pytest.approx(np.sqrt(np.mean(whole.floors[:6] ** 2)))
    (residual,) = part.residuals([World()])
    assert residual @ residual / part.count == pytest.approx(1.0, rel=0.3)


def test_one_unknown_controller_has_all_recordings_compared_by_torques():
    """Fitted and held-out ones alike, whichever side it is on; one without torques is then refused."""
    known = recorded(ROBOT, "iiwa14", World(), iiwa_segment("position", 2.0, seed=0), stream(0, "torque"))
    unknown = passively(World(), 1)
    assert evidence_for([known], beside=[known]).unit == "rad"
    for first, second in ((known, unknown), (unknown, known)):
        assert evidence_for([first], beside=[second]).unit == evidence_for([second], beside=[first]).unit == "N m"
        both = CHANNELS["joints"].evidence(World("iiwa14"), ([first], [second]), How())
        assert [type(side) for side in both] == [TorqueEvidence] * 2
    with pytest.raises(UserError, match="another recording's controller is unknown and no torque was measured"):
        evidence_for([replace(known, tau=None)], beside=[unknown])


@pytest.mark.parametrize("side", ["same", "other"])
def test_recordings_that_list_other_joints_are_refused(side):
    rec = passively(World(), 1)
    fewer = replace(rec, joints=rec.joints[:6], q=rec.q[:, :6], tau=rec.tau[:, :6])
    with pytest.raises(UserError, match="joints: recordings of different joints; expected joint1, joint2"):
        evidence_for([rec, fewer] if side == "same" else [fewer], beside=[rec])


def swung(k: int, size: float, hz: float, start: float = 0.0, rate: float = 200.0):
    """A hinge with 50 N m of dry friction on a sine of `size` rad, whose torque is read with noise of 0.1 N m."""
    robot, t, w = pendulum(0.0), np.arange(0.0, 20.0, 1.0 / rate), 2 * np.pi * hz
    q, dq = size * np.sin(w * (t + start)), size * w * np.cos(w * (t + start))
    tau = -SWING * w**2 * q + 50.0 * np.sign(dq) + 0.1 * stream(k, "swing").standard_normal(len(t))
    control = Control("unknown", rate)
    rec = Recording(Path("swing"), robot.source, robot.joints, rate, control, t, q[:, None], tau=tau[:, None])
    return replace(rec, torque_sensor="motor", noise={"tau": 0.1})


@pytest.mark.parametrize("other", [(0.020, 0.8), (0.015, 0.5, 0.0, 100.0)], ids=["motion", "rate"])
def test_two_small_motions_are_no_runs_of_one_motion(other):
    """Angles that differ by a degree are other motions where the motion itself is of a degree."""
    evidence = evidence_for([swung(0, 0.015, 0.5), swung(1, *other)])
    assert evidence.floor_from == "stated noise" and evidence.floors == pytest.approx([0.1])


def test_two_runs_of_a_small_motion_tell_the_noise():
    evidence = evidence_for([swung(k, 0.015, 0.5, 0.5 * k) for k in (0, 1)])
    assert evidence.floor_from == "repeats" and evidence.floors == pytest.approx([0.1], rel=0.1)


def test_dry_friction_is_against_the_motion(evidence):
    world = World().add(EffectInstance.of("coulomb_friction", "joint3", torque=1.5))
    for item, y in zip(evidence.items, evidence.simulated([World(), world]), strict=True):
        fast = np.abs(item.segment.dq[:, 2]) > 0.05
        expected = 1.5 * np.sign(item.segment.dq[fast, 2])
        np.testing.assert_allclose((y[1] - y[0])[fast, 2], expected, atol=1e-3)


def test_load_friction_grows_with_the_torque_on_the_links_alone(evidence):
    """What damping and the rotor take does not pass through the gear, as in the plant's `x.tau`."""
    rubs = EffectInstance.of("load_friction", "joint3", coefficient=0.2, stiffness=1e6)
    damped = World().add(
        EffectInstance.of("viscous_friction", "joint3", damping=20.0),
        EffectInstance.of("rotor_inertia", "joint3", inertia=1.0),
    )
    worlds = [World(), World().add(rubs), damped, damped.add(rubs)]
    for item, y in zip(evidence.items, evidence.simulated(worlds), strict=True):
        change = (y[1] - y[0])[:, 2]
        np.testing.assert_allclose((y[3] - y[2])[:, 2], change, atol=1e-9)
        fast, speed = np.abs(item.segment.dq[:, 2]) > 0.05, item.segment.dq[:, 2]
        rotor = compiled(ROBOT).dof_armature[2] * accelerations(item)[:, 2]
        expected = 0.2 * np.abs(y[0, :, 2] - rotor) * np.sign(speed)
        np.testing.assert_allclose(change[fast], expected[fast], rtol=0.02, atol=1e-3)


@pytest.mark.parametrize("name", sorted(n for n, e in REGISTRY.items() if "needed" in e.channels()))
def test_every_measurable_effect_can_be_asked(evidence, name):
    """Null changes nothing and the start value something, for each effect that is said to leave a trace."""
    kind = REGISTRY[name]
    where = kind.targets(ROBOT)[len(kind.targets(ROBOT)) // 2]
    start = World().add(EffectInstance.of(name, where, **{k: p.start for k, p in kind.params.items()}))
    null = World().add(EffectInstance.of(name, where))
    plain, zero, strong = evidence.simulated([World(), null, start])[0]
    np.testing.assert_allclose(zero, plain, atol=1e-12)
    assert np.isfinite(strong).all() and np.abs(strong - plain).max() > 1e-4


def test_friction_is_recovered_without_a_controller():
    truth = World().add(
        EffectInstance.of("viscous_friction", "joint4", damping=3.0),
        EffectInstance.of("coulomb_friction", "joint4", torque=2.0),
    )
    # the motor's side of the gear, where friction is part of what is read
    recs = []
    for s in (0, 1):
        rec = passively(truth, s)
        dq = smooth(rec.time, rec.q, 8.0)[1][:, 3]
        tau = rec.tau.copy()
        tau[:, 3] += 3.0 * dq + 2.0 * np.tanh(dq / 0.01)
        recs.append(replace(rec, tau=tau, torque_sensor="motor"))
    ev = evidence_for(recs)
    start = World().add(
        EffectInstance.of("viscous_friction", "joint4", damping=1.0),
        EffectInstance.of("coulomb_friction", "joint4", torque=0.5),
    )
    (result,) = run_together([fit_job(ev, start, [0, 1])], ev.residuals)
    found = [v.value for e in result.world.effects for v in e.params.values()]
    np.testing.assert_allclose(found, [3.0, 2.0], atol=0.15)
