"""A diagnosis by hand does what the command does, and a killed one goes on where it stood."""

import json
from dataclasses import replace

import numpy as np
import pressed
import pytest
from loops import ARM, drive, pendulum, recorded

from vispeg.api.diagnose import diagnose
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.rules import varied
from vispeg.core.seeds import stream
from vispeg.diagnosis.beginning import ANEW
from vispeg.recordings.load import load
from vispeg.recordings.write import write
from vispeg.robots.model import load as robot_of
from vispeg.view.diagnose.standing import Standing
from vispeg.view.diagnose.study import STEPS, Study
from vispeg.worlds.model_file import load_model, model_text
from vispeg.worlds.world import World


class Heard(list):
    def __call__(self, name, value):
        self.append((name, value))

    def last(self, name):
        return [value for at, value in self if at == name][-1]


def study(rigs, out, *, heard=None, model=None):
    sides = (rigs / "rig-a", rigs / "rig-b"), (rigs / "rig-c",)
    return Study(heard if heard is not None else Heard(), str(model or rigs / "arm.xml"), *sides, out, 1)


@pytest.fixture(scope="module")
def by_hand(rigs, tmp_path_factory):
    """(study, heard) after the best candidate was pressed."""
    heard, out = Heard(), tmp_path_factory.mktemp("view")
    made = study(rigs, out, heard=heard)
    made.show()
    made.screen()
    made.fit(heard.last("candidates")[0].key)
    return made, heard


def test_the_first_candidate_is_the_hidden_effect_and_the_error_falls_to_the_noise(by_hand):
    made, heard = by_hand
    assert heard.last("candidates")[0].key == "coulomb_friction:shoulder"
    assert heard.last("candidates")[0].share > 0.9
    now: Standing = heard.last("standing")
    assert [e.key for e in now.effects] == ["coulomb_friction:shoulder"] and now.effects[0].size.startswith("0.80")
    assert now.ladder[0].error > 100 * now.floor and now.ladder[-1].error < 3 * now.floor and now.enough


def test_the_moment_of_a_cell_is_the_sample_that_misses_most_there(by_hand):
    made, heard = by_hand
    first: Standing = [v for at, v in heard if at == "standing"][0]
    field = first.maps["time"]
    j = first.joints.index("shoulder")
    for i, (track, time) in enumerate(field.moment[j]):
        assert field.edges[i] - 1e-6 <= time <= field.edges[i + 1] + 1e-6 and track == 0
    assert np.nanmax(field.first[j]) > 3 * np.nanmax(field.first[1 - j])


@pytest.mark.slow
def test_the_search_by_itself_ends_with_the_model_of_the_command(rigs, tmp_path):
    made = study(rigs, tmp_path)
    made.run()
    command = diagnose(str(rigs / "arm.xml"), [rigs / "rig-a", rigs / "rig-b"], rigs / "rig-c", threads=1)
    assert made.state.world.label == command.world.label
    assert made.state.world.values == command.world.values
    errors = [rung["heldout_error"] for rung in command.record["ladder"]]
    assert [rung.error for rung in made.rungs] == pytest.approx(errors, rel=1e-9)


DRY = EffectInstance.of("coulomb_friction", "hinge", torque=0.5)
VISCOUS = EffectInstance.of("viscous_friction", "hinge", damping=0.5)
SPRING = EffectInstance.of("cable_spring", "hinge", stiffness=2.0, reference=0.2)
LIMIT = 2.3  # N m
NO_MORE = {"later": 1e9}  # of what the given effects removed: no effect is added


@pytest.mark.parametrize(
    ("hidden", "given", "rules", "moves"),
    [
        ((DRY,), (VISCOUS,), NO_MORE, ["exchanged Viscous friction at hinge for Coulomb friction at hinge"]),
        pytest.param(
            (DRY, SPRING), (), {}, ["+ Cable spring at hinge; + Coulomb friction at hinge"], marks=pytest.mark.slow
        ),
    ],
)
def test_every_move_of_the_command_is_a_step_of_the_page(hidden, given, rules, moves, tmp_path):
    """Exchanges too; each is said, and can be taken back and made again."""
    robot, heard = pendulum(), Heard()
    for i, name in enumerate(("rig-a", "rig-b", "rig-c")):
        swing = 0.4 * (1 - np.cos(2 * np.pi * (0.7 + 0.2 * i) * np.arange(400) * 5e-3))
        s = drive(robot, "position", 0.0, command=swing[:, None], seconds=2.0, rate=200.0, kp=60.0, kd=4.0)
        write(recorded(robot, robot.source, World().add(*hidden), s, stream(5, i)), tmp_path / name)
    model = tmp_path / "given.yaml"
    model.write_text(model_text(World(str(robot.source), effects=tuple(replace(e, partial=True) for e in given))))
    with varied(**rules):
        made = study(tmp_path, tmp_path / "out", heard=heard, model=model)
        first, known = made.state.world, len(made.rungs)
        made.run()
        assert [rung.words for rung in made.rungs[known:]] == moves
        assert {e.label for e in made.state.world.effects} == {e.label for e in hidden}
        assert made.rungs[-1].error < 0.1 * made.rungs[0].error
        last, rungs = made.state.world, made.rungs
        assert study(tmp_path, tmp_path / "out", model=model).state.world == last, "a killed one goes on where it stood"
        for _ in moves:
            made.undo()
        assert made.state.world == first
        for n in range(1, len(moves) + 1):
            assert made.advance() and made.rungs == rungs[: known + n]
        assert not made.advance() and made.state.world == last
        sides = [tmp_path / "rig-a", tmp_path / "rig-b"], tmp_path / "rig-c"
        command = diagnose(str(model), *sides, threads=1, part=made.part)
    assert made.state.world.label == command.world.label and made.state.world.values == command.world.values
    tried = [value for at, value in heard if at == "tried" and " in place of " in value.words]
    assert len(tried) == 2 * sum("exchanged" in words for words in moves) and not any(t.refused for t in tried)


@pytest.mark.slow
def test_contact_ends_with_the_names_of_the_command(tmp_path):
    """Also with those that no search finds; a superfluous effect that was added by hand is taken out at the end."""
    soft, heard = EffectInstance.of("fixture_compliance", "fixture", z=3e-5), Heard()
    for name, options in (("press-a", (0,)), ("press-b", (1, True))):
        rec, rng = pressed.recorded((soft,), *options), stream(5, f"louder {name}")
        louder = np.repeat([0.25, 0.0], 3) * rng.standard_normal(rec.ft.shape)
        write(replace(rec, ft=rec.ft + louder), tmp_path / name)
    sides = (tmp_path / "press-a",), (tmp_path / "press-b",)
    made = Study(heard, "peg-cell", *sides, tmp_path / "out", 1)
    made.run()
    command = diagnose("peg-cell", *sides, threads=1)
    names = ["fixture_compliance(fixture)", "wrench_noise(flange)"]
    made.save(tmp_path / "page.yaml", False)
    page = load_model(tmp_path / "page.yaml")
    assert [e.label for e in page.effects] == [e.label for e in command.world.effects] == names
    for label, values in command.world.values.items():
        assert page.values[label] == pytest.approx(values)
    steps = ["+ Fixture compliance at fixture", "intervals", "+ Wrench noise at the flange"]
    assert [rung.words for rung in made.rungs[1:]] == steps
    assert not made.advance()
    again = Study(heard, "peg-cell", *sides, tmp_path / "out", 1)
    assert again.rungs == made.rungs and again.standing().effects == made.standing().effects
    again.undo()
    assert [e.key for e in again.standing().effects] == ["fixture_compliance:fixture"]
    again.fit("contact_stiffness:peg", anyway=True)
    assert len(again.state.world.effects) == 2
    again.run()
    assert {e.key for e in again.standing().effects} == {e.key for e in made.standing().effects}


def test_recordings_change_their_roles_as_in_the_command(tmp_path):
    """The drive saturates in the first two: the held-out one shows nothing of it, so one of the two judges too."""
    robot, heard = pendulum(), Heard()
    for i, size in enumerate((0.4, 0.35, 0.02)):
        swing = size * (1 - np.cos(2 * np.pi * (0.9 + 0.1 * i) * np.arange(600) * 5e-3))
        s = drive(robot, "position", 0.0, command=swing[:, None], seconds=3.0, rate=200.0, kp=60.0, kd=4.0)
        world = World().add(EffectInstance.of("torque_limit", "hinge", limit=LIMIT))
        write(recorded(robot, robot.source, world, s, stream(5, i)), tmp_path / f"rig-{'abc'[i]}")
    made = study(tmp_path, tmp_path / "out", heard=heard, model=robot.source)
    assert any("judges" in text for at, text in heard if at == "say")
    made.show()
    assert [track.name for track in heard.last("standing").tracks] == ["rig-c", "rig-a"]
    made.run()
    sides = [tmp_path / "rig-a", tmp_path / "rig-b"], tmp_path / "rig-c"
    command = diagnose(str(robot.source), *sides, threads=1, part=made.part)
    assert command.record["recordings"] == {"fit": ["rig-b"], "validate": ["rig-c", "rig-a"]}
    assert made.rungs[0].error == pytest.approx(command.record["ladder"][0]["heldout_error"], rel=1e-9)
    assert made.state.world.label == command.world.label and made.state.world.values == command.world.values


@pytest.mark.slow
def test_several_effects_that_torques_propose_are_found_as_by_the_command(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    robot = robot_of(tmp_path / "arm.xml")
    world = World().add(
        EffectInstance.of("coulomb_friction", "shoulder", torque=0.5),
        EffectInstance.of("viscous_friction", "elbow", damping=0.5),
        EffectInstance.of("cable_spring", "shoulder", stiffness=2.0, reference=0.2),
    )
    for i, name in enumerate(("rig-a", "rig-b", "rig-c")):
        swing = 1 - np.cos(2 * np.pi * np.outer(np.arange(600) * 5e-3, [0.7 + 0.2 * i, 1.1 - 0.2 * i]))
        s = drive(robot, "position", 0.0, command=0.4 * swing, seconds=3.0, rate=200.0, kp=60.0, kd=4.0)
        write(recorded(robot, robot.source, world, s, stream(5, i)), tmp_path / name)
    made = study(tmp_path, tmp_path / "out")
    made.run()
    sides = [tmp_path / "rig-a", tmp_path / "rig-b"], tmp_path / "rig-c"
    command = diagnose(str(tmp_path / "arm.xml"), *sides, threads=1)
    assert {e.label for e in command.world.effects} == {e.label for e in world.effects}
    assert made.state.world.values == command.world.values
    (whole,) = [t for t in made.state.steps[0][1] if t.score.beside]
    assert {e.label for e in whole.score.members} >= {e.label for e in world.effects}


@pytest.mark.slow
def test_partial_effects_are_fitted_anew_and_the_search_ends_as_the_command_does(rigs, tmp_path):
    half = EffectInstance.of("coulomb_friction", "shoulder", torque=0.4)
    model, heard = tmp_path / "partial.yaml", Heard()
    model.write_text(model_text(World(str(rigs / "arm.xml"), effects=(replace(half, partial=True),))))
    made = study(rigs, tmp_path, heard=heard, model=model)
    made.show()
    now: Standing = heard.last("standing")
    assert [rung.words for rung in now.ladder] == ["the initial model", ANEW] and now.initial == ()
    assert now.effects[0].size.startswith("0.80") and now.ladder[1].error < 0.05 * now.ladder[0].error
    made.save(tmp_path / "now.yaml", False)
    (saved,) = load_model(tmp_path / "now.yaml").effects
    assert saved.partial and saved.params["torque"].value == pytest.approx(0.8, rel=0.05)
    made.run()
    command = diagnose(str(model), [rigs / "rig-a", rigs / "rig-b"], rigs / "rig-c", threads=1)
    assert made.state.world.label == command.world.label


@pytest.mark.slow
def test_steps_of_encoders_stand_in_the_ladder(rigs, tmp_path):
    """The readings show them before any search."""
    for name in ("rig-a", "rig-b", "rig-c"):
        rec = load(rigs / name)
        write(replace(rec, q=1e-3 * np.round(rec.q / 1e-3), robot=str(rigs / "arm.xml")), tmp_path / name)
    heard = Heard()
    made = study(tmp_path, tmp_path, heard=heard, model=rigs / "arm.xml")
    made.show()
    now: Standing = heard.last("standing")
    assert [rung.words for rung in now.ladder] == ["the initial model", "+ Encoder quantization everywhere"]
    assert [e.key for e in now.effects] == ["encoder_quantization:all"] and now.effects[0].size.startswith("1.00 mrad")
    made.fit("coulomb_friction:shoulder")
    assert [e.label for e in made.state.world.effects] == ["encoder_quantization(all)", "coulomb_friction(shoulder)"]
    made.undo()
    assert [e.label for e in made.state.world.effects] == ["encoder_quantization(all)"]


@pytest.mark.slow
def test_a_step_is_taken_back_whole(rigs, by_hand, tmp_path):
    heard = Heard()
    made = study(rigs, tmp_path, heard=heard)
    error, world = made.rungs[0].error, made.state.world
    made.fit("coulomb_friction:shoulder")
    made.undo()
    assert made.state.world == world and [r.error for r in made.rungs] == [error]
    assert json.loads((made.part / STEPS).read_text())["steps"] == []
    with pytest.raises(UserError, match="nothing to take back"):
        made.undo()


def test_a_killed_one_goes_on_where_it_stood(rigs, by_hand):
    made, _ = by_hand
    heard = Heard()
    again = study(rigs, made.part.parent, heard=heard)
    assert again.part == made.part and again.state.world == made.state.world and again.rungs == made.rungs


@pytest.mark.slow
def test_a_search_that_ended_and_was_killed_has_its_last_values(rigs, tmp_path):
    """And its steps can still be taken back."""
    made = study(rigs, tmp_path)
    made.run()
    assert made.rungs[-1].error == made.subject.error(made.state.world)
    again = study(rigs, tmp_path)
    assert again.state.world == made.state.world and again.rungs == made.rungs
    again.undo()
    assert again.state.world.effects == () and json.loads((again.part / STEPS).read_text())["steps"] == []


def test_another_search_in_the_same_folder_keeps_to_a_folder_of_its_own(rigs, by_hand, tmp_path):
    made, _ = by_hand
    other = tmp_path / "model.yaml"
    made.save(other, False)
    again = study(rigs, made.part.parent, model=other)
    assert again.part.name == "found-2.part" and not again.done


@pytest.mark.slow
def test_what_is_refused_is_not_added_unless_the_user_wants_it(rigs, tmp_path, elbow):
    heard = Heard()
    made = study(rigs, tmp_path, heard=heard)
    made.fit("coulomb_friction:shoulder")
    made.fit(f"viscous_friction:{elbow}")
    assert heard.last("tried").refused and len(made.state.world.effects) == 1
    made.fit(f"viscous_friction:{elbow}", anyway=True)
    assert len(made.state.world.effects) == 2 and len(made.rungs) == 3


def test_without_a_recording_to_judge_on_the_model_is_compared_and_nothing_is_added(rigs, tmp_path):
    heard = Heard()
    made = Study(heard, str(rigs / "arm.xml"), (rigs / "rig-a",), (), tmp_path, 1)
    made.show()
    assert not heard.last("standing").judged and heard.last("standing").ladder[0].error > 0
    with pytest.raises(UserError, match="to judge on"):
        made.screen()


def test_a_recording_with_a_wrench_and_pictures_shows_both_at_the_moment(tmp_path):
    from vispeg.cli.main import main
    from vispeg.recordings.load import load

    options = ["--motion", "look", "--size", "96x72", "--fps", "0.4", "--rate", "200", "--look", "S/4"]
    assert main(["record", "peg-cell", *options, "--out", str(tmp_path / "rig")]) == 0
    heard, rec = Heard(), load(tmp_path / "rig")
    made = Study(heard, "peg-cell", (tmp_path / "rig",), (), tmp_path / "out", 1)
    made.show()
    (track,) = heard.last("standing").tracks[:1]
    frames = rec.frames.of(rec.frames.names[0])
    assert rec.frames.names[0] in track.cameras
    assert track.measured is None and heard.last("standing").unit == "px"
    start = made.subject.recorded(0)[1]
    made.picture(0, float(frames.times[2] - start) + 0.1, rec.frames.names[0])
    seen = heard.last("pictured")
    assert seen.time == pytest.approx(frames.times[2] - start)
    measured, rendered = (seen.pictures[name].astype(float) for name in ("depth_measured", "depth_rendered"))
    assert measured.shape == rendered.shape == (72, 96, 3)
    assert np.median(np.abs(measured - rendered)) < 12  # of 255: the model is the right one
    with pytest.raises(UserError, match="took no picture"):
        made.picture(0, 0.0, "nobody")


@pytest.mark.slow
def test_a_report_of_its_own_is_replaced(rigs, tmp_path):
    """Written once more, the whole diagnosis takes the place of the one that the page wrote before."""
    made = study(rigs, tmp_path / "view")
    first = made.report()
    made.fit("coulomb_friction:shoulder")
    assert made.report() == first and (tmp_path / "view" / "found" / "report.html").is_file()
