"""Recordings of a cell: what each motion makes the tool do, and that a recording replays bit for bit."""

from dataclasses import replace

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.recordings.load import load
from vispeg.recordings.noise import NOISE
from vispeg.recordings.regimes import IMPACT, INSIDE, PRESS, REGIMES, SLIDE, Thresholds, regimes, touching
from vispeg.recordings.write import write
from vispeg.robots.model import load as load_robot
from vispeg.sim.touch import touch
from vispeg.task.belief import believed
from vispeg.task.rig.expert import record_expert
from vispeg.task.rig.motions import AIR, PATHS, Place, motion
from vispeg.task.rig.pace import ROOM, SAMPLES_HZ, followed, foreseen, paced, turned_by, with_room
from vispeg.task.rig.path import Frame, Path
from vispeg.task.rig.posture import elbow_turned, posture
from vispeg.task.rig.record import record_cell
from vispeg.task.rig.replay import replay
from vispeg.worlds.model_file import load_model

CELL = load_model("peg-cell")
SCENE = believed(CELL.cell)
COARSE = 2e-3  # s: what tests of shapes and signs can do with


def recorded(name, effects=(), noise=(), rate=250.0, **options):
    made = motion(name, SCENE.scene, SCENE.config, rate, np.random.default_rng(0))
    plant = CELL.add(*effects)
    options = {"h_max": COARSE, "rate_hz": rate} | options
    return record_cell(plant, made, dict(noise), np.random.default_rng(1), **options)


@pytest.fixture(scope="module")
def touches():
    """Each motion, recorded once with noise: the recording and what its tool touched."""
    out = {}
    for name in PATHS:
        rec = recorded(name, noise=NOISE)
        out[name] = rec, touch(rec, SCENE.scene)
    return out


@pytest.mark.parametrize("name", PATHS)
def test_every_motion_begins_with_a_second_in_free_air(touches, name):
    rec, seen = touches[name]
    assert not seen.touching[rec.time <= min(AIR, 1.0)].any()
    assert np.abs(np.diff(rec.ee_cmd[:, :3], axis=0)).max() * rec.rate_hz < 0.5, "m/s"


@pytest.mark.parametrize("name", PATHS)
def test_every_motion_keeps_each_joint_within_its_range_and_its_speed_limit(touches, name):
    rec, arm = touches[name][0], load_robot("iiwa14")
    assert np.all((rec.q > arm.range[:, 0] + 0.01) & (rec.q < arm.range[:, 1] - 0.01))
    assert np.all(np.abs(rec.dq) < arm.velocity_limit)


@pytest.mark.parametrize("name", PATHS)
def test_no_seed_of_a_motion_asks_for_angles_out_of_range(name):
    scene, stiffness = SCENE.scene, SCENE.config.stiffness
    near = elbow_turned(scene) if name == "press-elbow" else posture(scene)
    for seed in range(4):
        path = with_room(PATHS[name](Place(scene, np.random.default_rng(seed))), scene, stiffness, near)
        angles = foreseen(path, scene, stiffness, near)[1]
        assert np.minimum(angles - scene.range[:, 0], scene.range[:, 1] - angles).min() >= ROOM


@pytest.mark.parametrize(("yaw", "fits"), [(0.3, True), (-0.3, False)])
def test_a_motion_is_turned_only_as_far_as_its_joints_need(yaw, fits):
    """A nod stays as it is where the last joint has room for it; with that at its stop it turns away, the tip's way
    kept.
    """
    scene, stiffness, near = SCENE.scene, SCENE.config.stiffness, posture(SCENE.scene)
    nod = turned_by(Path(Frame((0.0, 0.0, 0.05))).to(1.0, turn=(0.05, 0.0, 0.0)).to(0.5), yaw)
    made = with_room(nod, scene, stiffness, near)
    assert made.start.yaw == (nod.start.yaw if fits else pytest.approx(-0.15))
    assert [leg.frame.tip for leg in made.legs] == [leg.frame.tip for leg in nod.legs]


def test_a_motion_without_room_is_refused_with_the_joint_its_range_and_its_angle(monkeypatch):
    scene, near = SCENE.scene, posture(SCENE.scene)
    monkeypatch.setattr("vispeg.task.rig.pace.ROUND", (0.0,))
    path = PATHS["touch-datum"](Place(scene, np.random.default_rng(0)))
    with pytest.raises(UserError, match=r"joint7 out of its range.*-3.05 to 3.05 rad.*got 3.1[0-9]"):
        with_room(path, scene, SCENE.config.stiffness, near)


def test_the_way_of_the_arm_is_foreseen(touches):
    """The angles that pacing works out are those of the simulated arm, which comes a tenth of a second late."""
    rec = touches["free"][0]
    every = round(rec.rate_hz / SAMPLES_HZ)
    near = posture(SCENE.scene)
    foreseen = followed(SCENE.scene, rec.ee_cmd[::every], near)
    measured = rec.q[::every]
    late = min(np.abs(measured[k:] - foreseen[: len(foreseen) - k]).max() for k in range(2, 9))
    assert late < 0.15, "rad"


def test_a_leg_is_slowed_as_far_as_its_joints_need_and_no_other():
    """However fast a leg was asked for, it takes the same time; one that is slow enough keeps its own to the bit."""
    scene, stiffness, near = SCENE.scene, SCENE.config.stiffness, posture(SCENE.scene)
    start = Path(Frame((0.0, 0.0, 0.1))).to(4.0, tip=(0.02, 0.0, 0.1))
    fast, faster = (Path(start.start) for _ in range(2))
    for path, seconds in ((fast, 0.6), (faster, 0.3)):
        path.legs += start.legs
        path.to(seconds, turn=(0.7, 0.0, 0.0)).to(0.5)
    a, b = ([leg.seconds for leg in paced(path, scene, stiffness, near).legs] for path in (fast, faster))
    assert a[1] == pytest.approx(b[1], rel=0.05)
    assert a[1] > 1.1 * 0.6
    assert (a[0], a[2]) == (b[0], b[2]) == (4.0, 0.5)


def test_each_motion_excites_what_it_is_for(touches):
    share = {name: np.bincount(t.regime, minlength=len(REGIMES)) / len(t.regime) for name, (_, t) in touches.items()}
    assert share["free"][0] == 1.0
    for name, regime, least in (
        ("press", PRESS, 0.3),
        ("slide", SLIDE, 0.1),
        ("insert", INSIDE, 0.3),
        ("insert-turned", INSIDE, 0.3),
        ("rock", INSIDE, 0.1),
        ("hard-press", PRESS, 0.4),
        ("tap", IMPACT, 0.01),
        ("touch-datum", PRESS, 0.2),
        ("look-and-insert", INSIDE, 0.1),
    ):
        assert share[name][regime] > least, name
    assert all(share["mix"][r] > 0.002 for r in (PRESS, SLIDE, INSIDE, IMPACT))
    look = share["look-and-insert"]
    assert look[0] > 0.5, "most of it is seen from free air"
    forces = {name: t.force for name, (_, t) in touches.items()}
    steady = {name: np.quantile(f, 0.99) for name, f in forces.items()}
    assert 22 < steady["press"] < 30 and 105 < steady["hard-press"] < 120
    assert touches["hard-press"][0].control.force_limit > 115


def test_the_flange_of_insert_turned_is_turned_by_a_quarter(touches):
    straight, turned = (touches[name][0].ee_cmd[:, 3:] for name in ("insert", "insert-turned"))
    cosine = np.abs(np.sum(straight[len(straight) // 2] * turned[len(turned) // 2]))
    assert np.isclose(2 * np.arccos(min(1.0, cosine)), np.pi / 2, atol=0.05)


def test_a_datum_is_the_table(touches):
    rec, seen = touches["touch-datum"]
    lowest = seen.tip[seen.touching, 2].min()
    assert np.isclose(lowest, -SCENE.scene.target[2], atol=3e-4)


def test_a_press_reads_the_force_that_the_contact_carries():
    """Newton's third law through the wrist: the contact force by wrench, weight and inertia is the simulator's own."""
    rec = recorded("press")
    seen = touch(rec, SCENE.scene)
    again = replay(rec, [CELL], h_max=COARSE)[0]
    still = (seen.regime == PRESS) & (np.abs(seen.velocity).max(axis=1) < 1e-4)
    assert still.sum() > 100
    assert np.quantile(np.abs(seen.force - again.touch[0])[still], 0.99) < 0.05, "N"
    assert (seen.contact[still, 2] > 0).all(), "the fixture pushes up"
    ratio = again.touch[0][still].max() / again.touch[0][still].min()
    assert ratio > 3, "several forces"


def test_weight_is_what_a_hanging_tool_reads():
    rec = recorded("free")
    weight = rec.tool["mass_kg"] * 9.81
    assert np.allclose(rec.ft[rec.time < 0.4].mean(axis=0)[:3], [0, 0, -weight], atol=0.02)


@pytest.mark.parametrize("name", ["insert", "press"])
def test_a_recording_without_noise_replays_bit_for_bit(tmp_path, name):
    rough = EffectInstance.of("contact_friction", "peg", scale=1.7)
    place = {"x": 5e-4} if name == "insert" else {"z": 5e-4}  # beside the goal the fixture is flat
    effects = (rough, EffectInstance.of("hole_offset", "fixture", **place))
    rec = recorded(name, effects)
    if name == "insert":
        assert rec.outcomes[0].success and rec.outcomes[0].depth > 0.02
    back = load(write(rec, tmp_path / "r"))
    nominal, same = (replay(back, [world], h_max=COARSE)[0] for world in (CELL, CELL.add(*effects)))
    assert np.array_equal(same.q[0], rec.q) and np.array_equal(same.ft[0], rec.ft)
    assert np.abs(nominal.q[0] - rec.q).max() > 1e-4, "without the effects it is another motion"


def test_repeats_are_episodes_with_noise_of_their_own():
    rec = recorded("tap", noise=NOISE, repeat=2)
    half = len(rec.time) // 2
    assert np.array_equal(np.unique(rec.episode), [0, 1])
    gap = rec.ft[:half] - rec.ft[half:]
    assert np.allclose(gap.std(axis=0), np.sqrt(2) * np.repeat([NOISE["ft"], NOISE["ft_torque"]], 3), rtol=0.1)


def test_the_noise_of_an_encoder_in_steps_comes_before_it_rounds():
    """Noise of a tenth of a step tips a reading over as often as its distribution says, and each run differently."""
    step, sigma = 1e-3, 1e-4
    coarse = EffectInstance.of("encoder_quantization", "all", step=step)
    true: list[np.ndarray] = []
    rec = recorded("free", (coarse,), {"q": sigma}, repeat=2, watch=true.append)
    first, second = (rec.q[rec.episode == k] for k in (0, 1))
    assert np.abs(rec.q / step - np.round(rec.q / step)).max() < 1e-9 and rec.noise["q"] == sigma
    moving = np.ptp(true[0], axis=0) > 20 * step
    tipped = (first / step - np.round(true[0] / step))[:, moving]
    squared = effect("encoder_quantization").reading_noise(sigma, {"step": step}) ** 2 / step**2
    assert np.mean(tipped**2) == pytest.approx(squared, rel=0.2)
    assert np.mean(first != second) > squared, "noise of its own"


def test_two_seeds_are_two_motions():
    a, b = (motion("press", SCENE.scene, SCENE.config, 250.0, np.random.default_rng(s)).ee_cmd for s in (0, 1))
    assert np.abs(a[: len(b)] - b[: len(a)]).max() > 1e-3


def test_a_touch_ends_at_half_of_what_began_it():
    force = np.array([0.0, 1.5, 2.5, 1.5, 0.5, 1.5, np.nan, 3.0])
    assert touching(force, 2.0).tolist() == [False, False, True, True, False, False, False, True]


def test_regimes_by_force_speed_and_depth():
    time = np.arange(8) * 0.01
    force = np.array([0.0, 0, 5, 5, 5, 5, 5, 0])
    speed = np.array([0.0, 0, 0, 0, 0.02, 0.02, 0, 0])
    depth = np.array([-1.0, -1, -1, -1, -1, 0.01, 0.01, 0.01])
    slow = np.zeros(8)
    assert regimes(time, force, speed, slow, depth).tolist() == [0, 0, PRESS, PRESS, SLIDE, INSIDE, INSIDE, 0]
    fast = np.where(np.arange(8) == 1, 0.05, 0.0)
    hit = regimes(time, force, speed, fast, depth, Thresholds(impact=0.015))
    assert hit.tolist() == [0, 0, IMPACT, IMPACT, SLIDE, INSIDE, INSIDE, 0]


def test_a_world_that_believes_in_a_tilt_says_so(tmp_path):
    cell = replace(CELL.cell, effects=({"effect": "hole_tilt", "where": "fixture", "params": {"roll": 0.03}},))
    plant = replace(CELL, cell=cell)
    found = believed(cell)
    made = motion("tap", found.scene, found.config, 250.0, np.random.default_rng(0))
    rec = record_cell(plant, made, {}, np.random.default_rng(1), h_max=COARSE, rate_hz=250.0)
    assert rec.cell == cell
    assert np.array_equal(replay(rec, [CELL], h_max=COARSE)[0].q[0], rec.q)


def test_an_insertion_of_the_task_s_own_policy_replays_bit_for_bit():
    """The episode as TaskSimulation ran it, under PoseControl, is what the recorded controller makes of it."""
    rough = EffectInstance.of("contact_friction", "peg", scale=1.5)
    rec = record_expert(CELL.add(rough), 3, {}, np.random.default_rng(0), rate_hz=200.0, h_max=COARSE)
    assert rec.outcomes[0].category == "success" and rec.outcomes[0].depth > 0.019
    assert rec.control.force_limit == SCENE.config.force_limit and rec.time[-1] > 2.0
    again = replay(rec, [CELL.add(rough)], h_max=COARSE)[0]
    assert np.array_equal(again.q[0], rec.q) and np.array_equal(again.ft[0], rec.ft)
    seen = touch(rec, SCENE.scene)
    assert not seen.touching[rec.time < 1.0].any() and seen.touching.any()


def test_an_episode_that_diverges_is_not_recorded():
    """Motors half as strong again, with commands and angles a tenth of a second late, drive the arm out of its loop."""
    strong = [EffectInstance.of("torque_gain", f"joint{k}", gain=1.5) for k in range(1, 8)]
    late = [EffectInstance.of(name, "all", delay=0.1) for name in ("command_delay", "sensor_delay")]
    with pytest.raises(UserError, match="the arm does not follow"):
        record_expert(CELL.add(*strong, *late), 3, {}, np.random.default_rng(0), rate_hz=25.0, h_max=5e-3)


def test_what_only_cameras_see_moves_nothing_and_hinders_nothing():
    looks = EffectInstance.of("camera_offset", "external", x=0.01), EffectInstance.of("exposure", "external")
    plain, seen = recorded("tap"), recorded("tap", looks)
    np.testing.assert_array_equal(seen.q, plain.q)
    ran = replay(plain, [CELL.add(*looks)], h_max=COARSE)
    np.testing.assert_array_equal(ran[0].q[0], plain.q)


def test_each_run_has_its_own_outcome():
    """The noise of rounding encoders moves every run otherwise; the force that it meets is its own."""
    coarse = EffectInstance.of("encoder_quantization", "all", step=2e-4)
    rec = recorded("insert", [coarse], {"q": 3e-4}, repeat=2)
    peaks = [outcome.peak_force for outcome in rec.outcomes]
    assert [outcome.episode for outcome in rec.outcomes] == [0, 1]
    read = [np.linalg.norm(rec.ft[rec.episode == k, :3], axis=1).max() for k in (0, 1)]
    assert np.diff(read) and np.diff(peaks)
