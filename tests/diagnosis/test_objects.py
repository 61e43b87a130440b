"""A free object's contact is named from its tosses: known truth from noise, and what no toss can tell."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from resuming import resumed

from vispeg.api.diagnose import diagnose
from vispeg.api.inputs import load_recording
from vispeg.core.assets import assets
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.diagnosis.objects import ObjectSearch, _next, contact_numbers, diagnose_object
from vispeg.diagnosis.window_profile import sizes
from vispeg.identify.restarts import SUBSTEPS, Restarts
from vispeg.identify.surface import line_job, with_intervals
from vispeg.recordings.importers.objects import import_object
from vispeg.recordings.objects import ObjectRecording, load_object_recording, rates, turn_between, write_object
from vispeg.report.build import render
from vispeg.report.evidence import Evidence
from vispeg.report.record import Record
from vispeg.robots.objects import CUBE, is_object, load_object
from vispeg.worlds.world import World

RATE, SAMPLES = 150.0, 70
NOISE = 2e-4, 1e-3  # m, rad


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    path = tmp_path_factory.mktemp("cube") / "cube.xml"
    path.write_text(CUBE)
    return path


def tossed(seed, count=20, friction=0.5, solref=(0.02, 1.0), steps=16):
    """Tosses by plain `mj_step` of so many steps a sample (the model has `SUBSTEPS`, 6), read with noise."""
    spec = mujoco.MjSpec.from_string(CUBE)
    spec.option.timestep = 1 / (RATE * steps)
    shape = spec.body("cube").geoms[0]
    shape.friction[0], shape.solref, shape.priority = friction, solref, 1
    model, rng = spec.compile(), np.random.default_rng(seed)
    data, pose, rate = mujoco.MjData(model), [], []
    for _ in range(count):
        mujoco.mj_resetData(model, data)
        turn = rng.normal(size=4)
        data.qpos[:] = [*rng.uniform(-0.1, 0.1, 2), rng.uniform(0.15, 0.25), *(turn / np.linalg.norm(turn))]
        data.qvel[:] = [*rng.uniform(-1.2, 1.2, 2), -0.3, *rng.normal(scale=3.0, size=3)]
        for _ in range(SAMPLES):
            pose.append(data.qpos.copy())
            rate.append(data.qvel.copy())
            mujoco.mj_step(model, data, steps)
    pose, rate = np.array(pose), np.array(rate)
    pose[:, :3] += rng.normal(scale=NOISE[0], size=(len(pose), 3))
    for p in pose:
        mujoco.mju_quatIntegrate(p[3:], rng.normal(scale=NOISE[1], size=3), 1.0)
    time = np.tile(np.arange(SAMPLES) / RATE, count)
    return ObjectRecording(Path(f"toss-{seed}"), "cube", RATE, time, pose, rate, np.repeat(np.arange(count), SAMPLES))


def test_a_rotation_between_two_orientations_turns_one_into_the_other():
    rng = np.random.default_rng(0)
    a = rng.normal(size=(50, 4))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    turn = rng.normal(size=(50, 3))
    turn *= (rng.uniform(0, 3.1, 50) / np.linalg.norm(turn, axis=1))[:, None]
    b = a.copy()
    for q, t in zip(b, turn, strict=True):
        mujoco.mju_quatIntegrate(q, t, 1.0)  # in the body's own frame
    assert np.allclose(turn_between(a, b), turn, atol=1e-9)
    assert np.allclose(turn_between(a, -b), turn, atol=1e-9)


def test_velocities_from_poses_are_those_of_free_flight():
    rec = tossed(1, 1)
    flight = slice(1, 12)
    found = rates(rec.pose, rec.time, rec.episode)[flight]
    assert np.abs(found - rec.rate[flight])[:, :3].max() < 4 * NOISE[0] * RATE
    assert np.abs(found - rec.rate[flight])[:, 3:].max() < 4 * NOISE[1] * RATE


def test_the_right_model_predicts_windows_to_their_floor_and_the_wrong_one_does_not(cube):
    truth = Restarts([tossed(2, 25)], load_object(cube), 0.04)
    right, wrong = truth.residuals([World(), World().add(EffectInstance.of("contact_friction", "cube", scale=0.4))])
    assert np.mean(right**2) < 3.0  # noise grows over a bounce, and the truth's steps are finer
    assert np.mean(wrong**2) > 2 * np.mean(right**2)
    assert truth.sigma[0] < 3 * NOISE[0] and truth.sigma[3] < 3 * NOISE[1]


def test_mass_changes_no_toss(cube):
    """In free flight and against a fixed table only forces over mass act."""
    evidence = Restarts([tossed(3, 8)], load_object(cube), 0.04)
    light, heavy = (World().add(EffectInstance.of("object_mass", "cube", scale=s)) for s in (1.0, 3.0))
    a, b = (evidence.simulated([w]) for w in (light, heavy))
    assert max(np.abs(x - y).max() for x, y in zip(a, b, strict=True)) < 1e-6


@pytest.mark.parametrize("friction", [0.18, 0.8])
def test_friction_is_recovered_inside_its_interval(cube, friction):
    evidence = Restarts([tossed(4, 30, friction=friction)], load_object(cube), 0.04)
    start = World().add(EffectInstance.of("contact_friction", "cube", scale=1.0))
    line = line_job(start, [0], spans=(0.9, 0.4))(evidence.residuals)
    fit = with_intervals(evidence, line.world, [0], np.random.default_rng(0))
    v = fit.effects[0].params["scale"]
    assert 0.97 * v.low <= friction / 0.5 <= 1.03 * v.high  # the truth's steps are finer
    assert v.high - v.low < 0.25 * v.value


def test_the_hidden_effect_is_named_and_what_tosses_cannot_tell_is_said(cube):
    model = load_object(cube)
    fit, judge = tossed(5, friction=0.18), tossed(6, friction=0.18)
    got = diagnose_object(World(robot=str(cube)), model, [fit], [judge])
    assert [e["effect"] for e in got.record["effects"]] == ["contact_friction"]
    assert abs(contact_numbers(model, got.world)["friction"] - 0.18) < 0.02
    assert any("object_mass" in note for note in got.record["notes"])
    rows = got.record["restarts"]
    assert rows[0]["after"]["rms_m"] < 0.7 * rows[0]["before"]["rms_m"]
    ladder = [rung["heldout_error"] for rung in got.record["ladder"]]
    assert ladder == [rows[0][side]["rms_m"] for side in ("before", "after")], "the last rung is the model written"
    assert got.record["effects"][0]["without"] == pytest.approx(ladder[0] / got.record["noise_floor"]["value"])
    assert 0.5 < got.record["effects"][0]["explains"] <= 1.1
    refused = {c["effect"] for c in got.record["candidates"]}
    assert refused and "object_mass" not in refused, "what changes no toss is not fitted"


def test_what_an_earlier_search_left_in_part_is_fitted_anew_and_has_its_profile(cube):
    partial = replace(EffectInstance.of("contact_friction", "cube", scale=0.7), partial=True)
    fit, judge = tossed(5, friction=0.18), tossed(6, friction=0.18)
    world = World(robot=str(cube)).add(partial)
    got = diagnose_object(world, load_object(cube), [fit], [judge])
    assert [e.label for e in got.added] == [f"{e['effect']}({e['where']})" for e in got.record["effects"]] != []
    profiles = {p["parameter"] for p in got.record["restarts"][0]["parameters"]}
    assert {p.partition(".")[0] for p in profiles} == {e.label for e in got.added}


TOLD = {"parameter": "contact_friction(cube).scale", "told": True}
COMMAND = "vispeg diagnose cube.xml --recording a --validate b --out found"


@pytest.mark.parametrize(
    ("parameters", "never", "said", "command"),
    [
        (
            [{**TOLD, "told": False}],
            [],
            "Let the object go by hand, 20 times",
            f"{COMMAND}-2 --recording NEW-RECORDING",
        ),
        ([TOLD], ["object_mass"], "Weigh the object five times", f"{COMMAND}-2"),
        ([TOLD], [], "Drop the object by hand from other heights", f"{COMMAND}-2 --recording NEW-RECORDING"),
    ],
)
def test_the_page_says_what_a_person_does_with_an_object(parameters, never, said, command):
    following = _next(never, [{"parameters": parameters}])
    values = {"format": "vispeg-diagnosis/1", "object": "cube", "verdict": "identified", "next_experiment": following}
    text = render(Record("diagnosis", values | {"provenance": {"command": COMMAND}}, Evidence()))
    page = text[text.index('id="next_experiment"') : text.index('id="provenance"')]
    assert said in page and "robot" not in page and "vispeg check" not in page  # which reads no tosses
    assert f"<pre>{command}</pre>" in page


def test_a_recording_is_read_back_and_an_archive_gives_the_same(tmp_path):
    rec = tossed(7, 3)
    write_object(rec, tmp_path / "toss")
    back = load_object_recording(tmp_path / "toss")
    assert np.abs(back.pose - rec.pose).max() < 1e-12 and np.array_equal(back.rate, rec.rate)
    state = np.hstack([rec.pose, rec.rate])
    np.savez(tmp_path / "all.npz", state=state, start=np.arange(0, 4 * SAMPLES, SAMPLES))
    some = import_object(tmp_path / "all.npz", "cube", RATE, 1, 3)
    assert np.array_equal(some.rate, rec.rate[SAMPLES:]) and len(some.tosses) == 2
    for first, last in ((0, 4), (2, 2)):
        with pytest.raises(UserError, match="episodes"):
            import_object(tmp_path / "all.npz", "cube", RATE, first, last)


def test_what_is_no_object_is_refused(cube, tmp_path):
    (tmp_path / "two.xml").write_text(
        CUBE.replace("</worldbody>", "<body><joint/><geom size='.1'/></body></worldbody>")
    )
    assert is_object(cube) and not is_object(tmp_path / "two.xml")
    with pytest.raises(UserError, match="not a free object"):
        load_object(tmp_path / "two.xml")
    for solref in ("0.02 -1", "-1000 1", "0 0", "0 -10", "0.02 0"):  # MuJoCo takes its default, or no stiffness
        (tmp_path / "mixed.xml").write_text(CUBE.replace("<geom type", f'<geom solref="{solref}" type'))
        with pytest.raises(UserError, match="solref: impossible contact of geom of body 'cube'"):
            load_object(tmp_path / "mixed.xml")
    with pytest.raises(UserError, match="another object"):
        Restarts([replace(tossed(8, 1), name_of="ball")], load_object(cube), 0.04)
    slow = replace(tossed(9, 1), rate_hz=30.0)
    with pytest.raises(UserError, match=r"toss-9.*rate_hz: .*than toss-8; expected 150\.0; got 30\.0"):
        Restarts([tossed(8, 1), slow, tossed(10, 1)], load_object(cube), 0.04)
    with pytest.raises(UserError, match="no recording of an object; expected a folder of its tosses; got 'Recording'"):
        diagnose(cube, [load_recording(assets() / "recordings/rig-a")], tossed(9, 1))


@pytest.mark.parametrize(
    ("key", "before", "more"),
    [
        ("pair", "</mujoco>", '<contact><pair geom1="table" geom2="shape"/></contact></mujoco>'),
        ("override", "<worldbody>", '<option><flag override="enable"/></option><worldbody>'),
    ],
)
def test_contact_parameters_that_effects_cannot_reach_are_refused(tmp_path, key, before, more):
    """With a contact pair or the override, MuJoCo ignores the geoms' parameters, and every effect does nothing."""
    (tmp_path / "cube.xml").write_text(CUBE.replace("<geom type", '<geom name="shape" type').replace(before, more))
    with pytest.raises(UserError, match=f"{key}: replaces .* at the body's geoms alone"):
        load_object(tmp_path / "cube.xml")


def test_a_killed_diagnosis_goes_on(cube, tmp_path):
    for seed, name in ((1, "a"), (2, "b")):
        write_object(tossed(seed, count=8, friction=0.25), tmp_path / name)
    resumed(cube, (tmp_path / "a", tmp_path / "b"), tmp_path, "what else would do as well")


def test_whatever_size_shows_one_that_is_tried_lowers_its_error():
    """To first order a trial of between once and twice the size does."""
    for kind in (effect(name) for name in ("contact_friction", "contact_damping", "contact_stiffness")):
        param = kind.params["scale"]
        tried = np.log(np.array(sizes(param)) / param.null)
        for hidden in (-1.2, -0.5, -0.06, 0.05, 0.3, 1.0):
            ratio = tried / hidden
            assert np.any((ratio >= 1.0) & (ratio <= 2.0)), (kind.name, hidden)


@pytest.mark.slow
def test_a_friction_that_shows_is_found_and_a_smaller_one_is_not(cube):
    """Of tosses without an effect, `shows_from` says which friction others would show: hidden beyond it and nearer.

    By the model's own steps: finer ones are another damping of contacts by some percent, which shows, too.
    """
    model, world = load_object(cube), World(robot=str(cube))

    def search(friction: float) -> ObjectSearch:
        fit = Restarts([tossed(11, friction=friction, steps=SUBSTEPS)], model, 0.041)
        judged = Restarts([tossed(12, friction=friction, steps=SUBSTEPS)], model, 0.041, sigma=fit.sigma)
        return ObjectSearch(fit, judged)

    plain = search(0.5)
    between = {row["effect"]: row["between"] for row in plain.shows_from(plain.start(world))}
    low, high = between["contact_friction"]["scale"]
    assert 0.8 < low < 1.0 < high < 1.25
    assert between["object_mass"] == {"scale": None}, "it moves no toss"
    for end in (low, high):
        beyond, nearer = (search(0.5 * end**times).run(world).world for times in (1.7, 0.3))
        assert [e.effect for e in beyond.effects] == ["contact_friction"] and not nearer.effects
