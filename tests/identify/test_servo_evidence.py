"""Goals and angles as evidence: a servo's loop is found from them alone, whatever the log's clock and load's unit."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loops import drive, iiwa_segment, pendulum, recorded

from vispeg.cli.main import main
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.diagnosis.run import diagnose
from vispeg.diagnosis.traces import arrays, traces
from vispeg.identify.evidence import Evidence
from vispeg.identify.excitation import Motion
from vispeg.identify.load import load_noise
from vispeg.identify.record import controller, record
from vispeg.recordings.load import load as load_recording
from vispeg.recordings.noise import noise_of
from vispeg.report.evidence import evidence_of
from vispeg.robots.model import load
from vispeg.sim.segments.segment import segments
from vispeg.worlds.entry import ranged
from vispeg.worlds.world import World

ROBOT, EXAMPLE = load("iiwa14"), Path(__file__).parents[2] / "docs" / "examples" / "so101"
SLOW = World().add(EffectInstance.of("servo", "joint4", natural_frequency=30.0, damping_ratio=0.6))


@pytest.fixture(scope="module")
def recording():
    return recorded(ROBOT, "iiwa14", SLOW, iiwa_segment("servo", 1.6), stream(1, "servo"))


def test_truth_leaves_white_noise_in_angles(recording):
    here = Evidence([recording])
    (item,) = here.items
    assert [c.kind for c in item.channels] == ["servo", "load"] and here.unit == "rad"
    right, wrong = (r.reshape(item.measured.shape)[:, :7][item.valid[:, :7]] for r in here.residuals([SLOW, World()]))
    assert np.mean(right**2) == pytest.approx(1.0, abs=0.1)
    assert np.mean(wrong**2) > 1e4


def test_a_servo_has_the_same_error_alone_and_beside_another_controller():
    robot, t, made = pendulum(), np.arange(300) * 5e-3, []
    for mode, gains in (("servo", {}), ("position", {"kp": 60.0, "kd": 4.0})):
        goal = 0.4 * (1 - np.cos(2 * np.pi * 0.8 * t))[:, None]
        s = drive(robot, mode, goal[0], command=goal, seconds=1.5, rate=200.0, **gains)
        made.append(recorded(robot, robot.source, World(), s, stream(2, mode)))
    alone, both = (Evidence(some).residuals([World()])[0] for some in (made[:1], made))
    np.testing.assert_array_equal(both[: len(alone)], alone)


@pytest.mark.parametrize("unit", [37.0, -0.2])
def test_a_load_counts_by_its_shape(recording, unit):
    """Neither its unit nor its sign's convention changes a residual."""
    other = Evidence([replace(recording, load=unit * recording.load)])
    for a, b in zip(Evidence([recording]).residuals([SLOW, World()]), other.residuals([SLOW, World()]), strict=True):
        np.testing.assert_allclose(a, b if unit > 0 else _flipped(b), atol=1e-6)


def _flipped(residual: np.ndarray) -> np.ndarray:
    """A load of the other sign has residuals of the other sign."""
    out = residual.reshape(-1, 14).copy()
    out[:, 7:] *= -1
    return out.ravel()


def test_a_joint_whose_load_is_never_read_changes_no_other(recording):
    some = np.arange(7) != 6
    holed = replace(recording, load=np.where(some, recording.load, np.nan))
    np.testing.assert_allclose(load_noise(holed.load)[some], load_noise(recording.load[:, some]), rtol=1e-12)
    whole, part = (e.residuals([SLOW])[0].reshape(-1, 14) for e in map(lambda r: Evidence([r]), (recording, holed)))
    np.testing.assert_array_equal(part[:, :7], whole[:, :7])
    np.testing.assert_allclose(part[:, 7:13], whole[:, 7:13], rtol=0.1)  # the least noise is that of the joints read
    assert not part[:, 13].any()


def test_a_load_without_a_sign_is_a_magnitude(recording):
    here = Evidence([replace(recording, load=np.abs(recording.load))])
    y = here.simulated([SLOW])[0][0]
    assert (y[:, 7:] >= 0).all()
    assert np.mean(here.residuals([SLOW])[0] ** 2) < np.mean(here.residuals([World()])[0] ** 2)


def test_goals_hold_from_row_to_row():
    """A log at 49.85 Hz: each goal reaches the servo at its own row, never before, and within a tick of it."""
    time = np.arange(200) / 49.85
    goal = np.where(time < 2.0, 0.0, 0.5)[:, None]
    rec = replace(made(0.02), time=time, q=np.zeros((200, 1)), q_cmd=goal, rate_hz=50.0, episode=None, load=None)
    (segment,) = segments(rec)
    grid, sent = np.arange(segment.ticks) * segment.tick, segment.command["q_cmd"][:, 0]
    step, arrives = time[np.argmax(goal[:, 0] > 0)], grid[np.argmax(sent > 0)]
    assert set(np.unique(sent)) == {0.0, 0.5} and 0 <= arrives - step <= segment.tick + 1e-9


def test_a_coarse_encoder_is_as_noisy_as_its_step():
    q = np.round(0.1 * np.sin(np.arange(400) / 200.0) / 1.5e-3)[:, None] * 1.5e-3
    rec = replace(made(0.02), time=np.arange(400) / 50.0, q=np.hstack([q, 0 * q]), load=None, noise={})
    assert noise_of(rec)["q"] == pytest.approx(1.5e-3 / np.sqrt(12), rel=0.5)  # the joint at rest, too


def test_a_task_that_sends_torques_refuses_a_servo():
    entry = {"effect": "servo", "where": "all", "params": {"natural_frequency": 20.0}}
    with pytest.raises(UserError, match="servo would change nothing"):
        ranged(entry, ROBOT, Path("world.yaml"), "effects.0")


def made(noise: float, seed: int = 0, *effects: EffectInstance):
    """The pendulum under a servo at 50 Hz, on steps and strokes."""
    robot = pendulum()
    time = np.arange(200) / 50.0
    goal = 0.4 * np.sin(2 * np.pi * (0.3 + 0.1 * seed) * time) + np.where(time % 2 < 1, 0.0, 0.3)
    motion = Motion("strokes", time, goal[:, None], np.gradient(goal, time)[:, None])
    world = World(robot.source, None, effects)
    rec = record(world, motion, controller(robot, "servo", 50.0, np.zeros(1)), {"q": noise}, stream(seed, "made"))
    assert rec.control.kp is None and rec.dq_cmd is None and rec.tau is None
    return rec


def test_diagnosis_names_a_servo():
    """From goals and angles alone: a soft, badly damped servo, its parameters inside their intervals."""
    truth = EffectInstance.of("servo", "hinge", natural_frequency=22.0, damping_ratio=0.5)
    recs = [made(5e-4, seed, truth) for seed in (0, 1, 2)]
    out = diagnose(World(recs[0].robot), recs[:2], recs[2:], nthread=1, plan_next=False)
    (placed,) = out.world.effects
    assert placed.effect == "servo"
    for name in ("natural_frequency", "damping_ratio"):
        v = placed.params[name]
        assert v.low <= truth.params[name].value <= v.high and v.high - v.low < 0.3 * v.value
    last = out.record["ladder"][-1]["heldout_error"]
    assert last < 1.2 * out.record["noise_floor"]["value"]


@pytest.mark.parametrize("turned", [False, True])
def test_a_servo_beside_a_known_loop_keeps_its_own_track(turned):
    """Both angles are principal, in either order; the torque is that of the known loop."""
    robot, time = pendulum(), np.arange(300) / 100.0
    goal = 0.4 * np.sin(2 * time)[:, None]
    driven = controller(robot, "position", 100.0, np.zeros(1))
    known = record(World(robot.source), Motion("sway", time, goal, goal), driven, {}, stream(1, "made"))
    recs = [known, replace(made(0.0), load=0.0 * made(0.0).q)][:: -1 if turned else 1]
    here = Evidence(recs)
    got = evidence_of(arrays(traces(here.items, here.simulated([World(robot.source)])), robot.joints))
    assert [t.channel for t in got.traces] == ["angle", "servo"][:: -1 if turned else 1]
    assert [len(t.time) for t in got.traces] == [len(item.valid) for item in here.items]
    (torque,) = got.torques
    np.testing.assert_array_equal(torque.measured, known.tau)


def test_a_table_of_a_lerobot_arm_converts_and_compares(tmp_path, capsys):
    """The shipped map and model take a log as that arm writes it."""
    names = ("Rotation", "Pitch", "Elbow", "Wrist_Pitch", "Wrist_Roll", "Jaw")
    heads = ["t_s", *(f"{kind}_{n}" for kind in ("goal_rad", "angle_rad", "speed_rad_s", "load_nm") for n in names)]
    time = np.arange(200) / 49.85
    goal = 0.3 + 0.1 * np.sin(2 * time)[:, None] * np.ones(6)
    angle = 0.3 + 0.1 * np.sin(2 * (time - 0.05))[:, None] * np.ones(6)
    table = np.column_stack([time, goal, angle, 0 * goal, np.abs(goal - angle)])
    with gzip.open(tmp_path / "log.csv.gz", "wt") as file:
        np.savetxt(file, table, delimiter=",", header=",".join(heads), comments="")
    robot, out = str(EXAMPLE / "arm.xml"), tmp_path / "run"
    given = ["--robot", robot, "--map", str(EXAMPLE / "map.yaml"), "--out", str(out)]
    assert main(["convert", str(tmp_path / "log.csv.gz"), *given]) == 0
    rec = load_recording(out)
    assert rec.control.mode == "servo" and rec.load is not None and rec.tau is None
    np.testing.assert_allclose(rec.q_cmd, goal)
    capsys.readouterr()
    assert main(["compare", robot, "--recording", str(out), "--out", str(tmp_path / "compared")]) == 0
    assert "mrad RMS" in capsys.readouterr().out
