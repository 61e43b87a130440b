"""A recording in which nothing shows that a model lacks cannot judge what it lacks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loops import ARM, drive, hinge, pendulum, recorded

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.roles import halves, recast, shown, sides
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.run import diagnose
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.search import Search
from vispeg.identify.evidence import Evidence
from vispeg.identify.inverse import TorqueEvidence
from vispeg.recordings.recording import Control
from vispeg.report.text import words
from vispeg.robots.model import load
from vispeg.worlds.world import World

LIMIT = EffectInstance.of("torque_limit", "shoulder", limit=14.0)  # N m


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Motions that ask the shoulder for more than its drive gives: two all their time, one in its first half."""
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    robot, out = load(path), {}
    t = np.arange(1000) * 5e-3
    once = 0.05 + 0.75 * np.exp(-(((t - 1.0) / 0.4) ** 2))[:, None]
    for k, (name, size) in enumerate([("wide", 0.8), ("wider", 0.75), ("narrow", 0.05), ("once", once)]):
        out[name] = swung(robot, name, k, size)
    return out


def swung(robot, name: str, k: int, size, limit: EffectInstance = LIMIT):
    """A swing of 5 s, of `size` rad, under position control."""
    t = np.arange(1000) * 5e-3
    swing = size * (1 - np.cos(2 * np.pi * np.outer(t, [1.1 + 0.1 * k, 0.9])))
    s = drive(robot, "position", 0.0, command=swing, seconds=5.0, rate=200.0, kp=60.0, kd=4.0)
    return replace(recorded(robot, robot.source, World().add(limit), s, stream(5, k)), path=Path(name))


def roles(recordings, fitted: list[str], held_out: list[str]):
    world = World(recordings["wide"].robot)
    evidence, judged = (Evidence([recordings[n] for n in names]) for names in (fitted, held_out))
    return recast(world, evidence, judged), evidence, judged


def test_a_recording_that_shows_something_is_held_out_beside_one_that_shows_nothing(recordings):
    world = World(recordings["wide"].robot)
    found, evidence, judged = roles(recordings, ["wide", "wider"], ["narrow"])
    assert min(shown(evidence, world)) > RULES.loud and max(shown(judged, world)) == pytest.approx(1.0, abs=0.1)
    assert found is not None
    most = int(np.argmax(shown(evidence, world)))
    assert [r.name for r in found.fitted] == [["wide", "wider"][most]], "what shows most is fitted"
    assert [r.name for r in found.held_out] == ["narrow", ["wider", "wide"][most]]
    assert "narrow" in found.note and f"{found.held_out[1].name} judges" in found.note
    mean = float(np.mean(evidence.residuals([world])[0] ** 2) * evidence.items[0].measured.size * 2 / evidence.count)
    assert np.mean(shown(evidence, world)) == pytest.approx(mean, rel=0.05), "the error of all is that of its parts"


def test_what_one_half_of_one_recording_shows_is_said_to_be_judged_nowhere(recordings):
    found, evidence, judged = roles(recordings, ["narrow", "once"], ["narrow"])
    assert found is not None
    assert found.fitted == evidence.recordings[:1], "it would hide what the others show"
    assert found.held_out == judged.recordings
    assert "once is" in found.note and "before another shows it" in found.note and found.alone == "once"


def test_a_note_on_a_changed_recording_is_kept_in_its_new_role(recordings):
    """The evidence in the new roles has the recording as it was changed, and does not say so again."""
    robot = load(recordings["wide"].robot)
    weak = swung(robot, "weak", 0, 0.8, EffectInstance.of("torque_limit", "shoulder", limit=8.0))
    evidence, judged = Evidence([weak]), Evidence([recordings["narrow"]])
    (note,) = [note for note in evidence.notes if "saturated" in note]
    found = recast(World(weak.robot), evidence, judged)
    assert found is not None and found.held_out is not judged.recordings and found.converted == (note,)
    assert note not in Evidence(found.fitted).notes + Evidence(found.held_out).notes


def test_what_both_halves_of_one_recording_show_is_judged_by_the_second(recordings):
    found, *_ = roles(recordings, ["narrow", "wide"], ["narrow"])
    assert found is not None and not found.alone
    assert [r.name for r in found.fitted] == ["wide, first half", "narrow"]
    narrow, second = found.held_out
    assert narrow.name == "narrow"
    assert second.name == "wide, second half" and second.compared is not None
    wide = recordings["wide"]
    assert np.array_equal(second.q, wide.q), "the whole is simulated"
    assert np.array_equal(second.compared, wide.time >= wide.time[len(wide.time) // 2]), "the second half is compared"
    assert found.fitted[0].time[-1] < wide.time[second.compared][0]


def test_the_half_that_judges_leaves_only_noise_of_the_true_model(recordings):
    """A drive saturates at the cut, so that a rollout that begins there would start from a wrong state."""
    found, evidence, _ = roles(recordings, ["narrow", "wide"], ["narrow"])
    truth, judged = World(recordings["wide"].robot).add(LIMIT), Evidence(found.held_out)
    (cut,) = shown(Evidence([halves(recordings["wide"])[1]]), truth)
    (whole,) = shown(Evidence([recordings["wide"]]), truth)
    error = shown(judged, truth)[1]
    assert error == pytest.approx(whole, rel=0.15) and cut > RULES.loud > error
    assert Evidence(found.held_out[1:]).count == pytest.approx(Evidence([recordings["wide"]]).count / 2, rel=0.1)
    assert shown(judged, World(recordings["wide"].robot))[1] > RULES.loud


def test_the_halves_of_short_episodes_last_as_long_together(recordings):
    """The clock restarts with each of four episodes of 1.25 s, so that it spans no half of 2.5 s."""
    number = np.repeat(np.arange(4), 250)
    wide = replace(recordings["wide"], episode=number, time=recordings["wide"].time - 1.25 * number)
    found, *_ = roles({**recordings, "wide": wide}, ["narrow", "wide"], ["narrow"])
    assert found is not None and [r.name for r in found.held_out] == ["narrow", "wide, second half"]
    second = found.held_out[1]
    assert set(second.episode[second.compared]) == {2, 3}


@pytest.mark.parametrize("held_out", ["wide", "narrow"])
def test_roles_stay_where_they_will_do(recordings, held_out):
    """The judge shows what is missing, or nothing shows anywhere."""
    assert roles(recordings, ["wider"] if held_out == "wide" else ["narrow"], [held_out])[0] is None


def test_a_controller_unknown_on_one_side_has_both_sides_judged_by_torques(recordings):
    """The floor is the held-out recording's, whose noise is estimated; the fitted one states its own."""
    narrow = replace(recordings["narrow"], torque_sensor="motor", noise={})
    unknown = replace(recordings["narrow"], torque_sensor="motor", control=Control("unknown", 200.0), q_cmd=None)
    record = diagnose(World(narrow.robot), [unknown], [narrow], nthread=1, plan_next=False).record
    judged = TorqueEvidence([narrow])
    assert {row["unit"] for row in record["ladder"]} == {record["noise_floor"]["unit"]} == {"N m RMS"}
    assert (record["noise_floor"]["from"], record["noise_floor"]["value"]) == ("estimated", judged.floor)


def test_a_search_in_the_roles_asked_for_leaves_nothing_in_the_progress_for_other_roles():
    """Torques of a pendulum with dry friction in two recordings, and none in the third, which is held out.

    The last of the first two judges in its place, so that nothing that was fitted to it may be had again.
    """
    robot, out = pendulum(), []
    for i, torque in enumerate((0.8, 0.6, 0.0)):
        t = np.arange(600) * 5e-3
        q = 0.4 * (1 - np.cos(2 * np.pi * (0.9 - 0.2 * i) * t))[:, None]
        s = drive(robot, "position", q[0], command=q, seconds=3.0, rate=200.0, kp=60.0, kd=4.0)
        friction, options = hinge("coulomb_friction", torque=torque), {"tau_noise": 0.1, "sensor": "motor"}
        rec = recorded(robot, robot.source, friction, s, stream(3, i), **options)
        out.append(replace(rec, path=Path("ABC"[i]), control=Control("unknown", 200.0), q_cmd=None))
    world, progress = World(robot.source), Progress()
    search = Search(TorqueEvidence(out[:2]), Judge(TorqueEvidence(out[2:])), progress=progress)
    search.offers(search.start(world))
    again, fresh = (
        diagnose(world, out[:2], out[2:], nthread=1, plan_next=False, progress=p) for p in (progress, Progress())
    )
    assert again.record["recordings"] == {"fit": ["A"], "validate": ["C", "B"]}
    assert again.world == fresh.world and again.record["candidates"] == fresh.record["candidates"]


@pytest.mark.slow
def test_a_limit_that_the_validation_never_touches_is_named(recordings):
    given = [recordings["wide"], recordings["wider"]], [recordings["narrow"]]
    record = diagnose(World(recordings["wide"].robot), *given, nthread=1, plan_next=False).record
    assert [(e["effect"], e["where"]) for e in record["effects"]] == [("torque_limit", "shoulder")]
    assert record["effects"][0]["params"]["limit"]["value"] == pytest.approx(14.0, rel=0.01)
    assert set(record["recordings"]["fit"]) | set(record["recordings"]["validate"]) == {"wide", "wider", "narrow"}
    assert "narrow" in record["recordings"]["validate"] and any("judges" in note for note in record["notes"])


@pytest.mark.slow
def test_what_one_recording_alone_shows_leaves_no_model_adequate(recordings):
    """Nothing can be named, and the model is not adequate: the limit shows in one recording, which none can judge."""
    narrow, once = recordings["narrow"], recordings["once"]
    record = diagnose(World(once.robot), [narrow, once], [narrow], nthread=1).record
    assert record["verdict"] == "unexplained" and record["effects"] == []
    assert record["unexplained"] is not None and record["unexplained"]["shows_in"] == "once"
    assert record["unexplained"]["explained_share"] == 0.0
    assert record["next_experiment"] is not None and "motion like it" in record["next_experiment"]["why"]
    assert "only in once" in words.verdict(record)


def test_what_a_fitted_recording_alone_shows_beside_a_named_effect_leaves_the_rest_unexplained(tmp_path):
    """Friction of the elbow shows in all; the shoulder's drive saturates in a fitted one and in none that judges."""
    (tmp_path / "arm.xml").write_text(ARM)
    robot, recs, t = load(tmp_path / "arm.xml"), [], np.arange(600) * 5e-3
    friction = EffectInstance.of("viscous_friction", "elbow", damping=0.3)
    world = World().add(friction, EffectInstance.of("torque_limit", "shoulder", limit=6.0))
    for i, size in enumerate((0.3, 0.5, 0.3)):
        swing = (1 - np.cos(2 * np.pi * np.outer(t, [0.9 - 0.05 * i, 0.7 + 0.1 * i]))) * [size, 0.3]
        s = drive(robot, "position", 0.0, command=swing, seconds=3.0, rate=200.0, kp=60.0, kd=4.0)
        rec = recorded(robot, robot.source, world, s, stream(5, i), h_max=1e-3)
        recs.append(replace(rec, path=Path("ABC"[i])))
    record = diagnose(World(robot.source), recs[:2], recs[2:], nthread=1).record
    assert record["verdict"] == "unexplained" and record["unexplained"]["shows_in"] == "B"
    assert record["unexplained"]["explained_share"] > 0.99
    assert "what B alone shows cannot be judged" in record["reason"]
    assert words.verdict(record).endswith(
        "but what is left shows only in B, so no other recording can test an explanation."
    )
    assert [(e["effect"], e["where"]) for e in record["effects"]] == [(friction.effect, friction.where)]
    assert record["next_experiment"] is not None and "motion like it" in record["next_experiment"]["why"]


def test_what_the_model_explains_of_a_recording_that_was_left_out_is_fitted(tmp_path):
    """Friction shows in all, but by far most in one half of A, which no other half can judge."""
    (tmp_path / "arm.xml").write_text(ARM)
    robot, recs, t = load(tmp_path / "arm.xml"), [], np.arange(1000) * 5e-3
    friction = EffectInstance.of("viscous_friction", "elbow", damping=0.3)
    for i, peak in enumerate((0.6, 0.0, 0.0)):
        size = 0.03 + peak * np.exp(-(((t - 1.0) / 0.4) ** 2))[:, None]
        swing = size * (1 - np.cos(2 * np.pi * np.outer(t, [0.9 - 0.05 * i, 0.7 + 0.1 * i])))
        s = drive(robot, "position", 0.0, command=swing, seconds=5.0, rate=200.0, kp=60.0, kd=4.0)
        rec = recorded(robot, robot.source, World().add(friction), s, stream(5, i), h_max=1e-3)
        recs.append(replace(rec, path=Path("ABC"[i])))
    world = World(robot.source)
    parts = sides(world, recs[:2], recs[2:], 1)
    assert [r.name for r in parts.fitted] == ["B"] and parts.outdone(world) is not None
    record = diagnose(world, recs[:2], recs[2:], nthread=1, plan_next=False).record
    assert record["verdict"] == "identified" and record["recordings"] == {"fit": ["A", "B"], "validate": ["C"]}
    assert [(e["effect"], e["where"]) for e in record["effects"]] == [(friction.effect, friction.where)]
    assert not [note for note in record["notes"] if "alone shows" in note]
