"""Several channels, one diagnosis: each looks again with what the others named that concerns it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vispeg.channels.channel import CHANNELS, How
from vispeg.channels.conduct import ChannelResult, joined, search_in_turn, with_rest
from vispeg.channels.joints import carrying
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.diagnosis.run import Diagnosis
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.recording import Control, Recording
from vispeg.report.build import write_report
from vispeg.report.text.summary import Line
from vispeg.report.text.terminal import diagnosis_summary
from vispeg.report.write import write_diagnosis
from vispeg.task.belief import believed
from vispeg.worlds.places import values
from vispeg.worlds.world import World

ARM = World("iiwa14", "meg50+peg16", cell=CellBelief("nominal"))
OFFSET = EffectInstance.of("encoder_offset", "joint6", offset=0.004)
CAMERA = EffectInstance.of("camera_offset", "wrist_wide", x=0.004)
FRICTION = EffectInstance.of("contact_friction", "peg", scale=1.7)
HOLE = EffectInstance.of("hole_offset", "fixture", x=0.002)


def answer(world: World, found: tuple[EffectInstance, ...], unit: str, verdict: str = "", error: float = 1.0):
    """What a channel says that names `found` beside its model."""
    rungs = [("nominal", 8.0), *((f"+ {e.label}", error) for e in found)]
    listed = [
        {"effect": e.effect, "where": e.where, "params": {k: {"value": v.value} for k, v in e.params.items()}}
        | {"indistinguishable_from": []}
        for e in found
    ]
    record = {
        "format": "vispeg-diagnosis/1",
        "verdict": verdict or ("identified" if found else "adequate"),
        "reason": f"in {unit}",
        "effects": listed,
        "ladder": [{"model": m, "fit_error": e, "heldout_error": e, "unit": f"{unit} RMS"} for m, e in rungs],
        "noise_floor": {"value": 1.0, "unit": f"{unit} RMS", "from": "stated noise"},
        "unexplained": {"depends_on": [], "text": "much is left"} if verdict == "unexplained" else None,
        "next_experiment": None,
        "candidates": [],
        "channels": [
            {"channel": unit, "joint": "a", "floor": 1.0, "before": 8.0, "after": error, "unit": f"{unit} RMS"}
        ],
        "recordings": {"fit": ["a"], "validate": ["b"]},
        "notes": [f"a note in {unit}"],
    }
    return Diagnosis(record, world.add(*found), {"unit": np.array(unit)})


class Channels:
    """Three channels that say what was written for them, and remember what they were asked."""

    def __init__(self, joints=(), pictures=(), contact=()):
        self.asked: list[tuple[str, tuple[str, ...]]] = []
        self.said = {"joints": joints, "pictures": pictures, "contact": contact}

    def _answer(self, channel, world: World) -> Diagnosis:
        given, said = tuple(e.label for e in world.effects), self.said[channel.name]
        self.asked.append((channel.name, given))
        told = said(given) if callable(said) else said
        verdict = "unexplained" if any(e.partial for e in told) else ""
        return answer(world, tuple(e for e in told if e.label not in given), channel.name, verdict)

    def run(self) -> Diagnosis:
        channels = [CHANNELS[name] for name in self.said]
        return joined(search_in_turn(channels, ARM, self._answer, lambda text: None), ARM)


def test_channels_that_have_nothing_to_tell_each_other_are_searched_once():
    asked = Channels(pictures=(CAMERA,), contact=(FRICTION,))
    found = asked.run()
    assert [name for name, _ in asked.asked] == ["joints", "pictures", "contact"]
    assert [e.label for e in found.world.effects] == [CAMERA.label, FRICTION.label] and found.world.cell == ARM.cell
    assert found.record["verdict"] == "identified"
    assert [e["channel"] for e in found.record["effects"]] == ["pictures", "contact"]
    assert [r["channel"] for r in found.record["by_channel"]] == ["joints", "pictures", "contact"]
    assert {"channel/joints/unit", "channel/pictures/unit", "channel/contact/unit"} == set(found.arrays)


def test_none_of_them_finds_anything_where_nothing_is():
    found = Channels().run()
    assert found.record["verdict"] == "adequate" and not found.record["effects"] and found.world == ARM


def test_an_arms_error_is_no_cameras_and_no_holes():
    """Each channel would blame its own; given what the joints named, none does."""
    asked = Channels(
        joints=(OFFSET,),
        pictures=lambda given: () if OFFSET.label in given else (CAMERA,),
        contact=lambda given: () if OFFSET.label in given else (HOLE,),
    )
    found = asked.run()
    assert [e.label for e in found.world.effects] == [OFFSET.label]
    assert found.record["by_channel"][1]["given"] == [{"effect": "encoder_offset", "where": "joint6"}]


def test_a_channel_is_searched_again_with_what_a_later_one_named():
    """A hole that the wrench finds elsewhere stands elsewhere in the pictures, too."""
    moved = replace(CAMERA, partial=True)
    asked = Channels(pictures=lambda given: () if HOLE.label in given else (moved,), contact=(HOLE,))
    found = asked.run()
    assert asked.asked[3:] == [("pictures", (HOLE.label,))]
    assert [e.label for e in found.world.effects] == [HOLE.label] and found.record["verdict"] == "identified"


def test_channels_whose_results_depend_on_one_another_come_to_an_end():
    """The joints find one offset unless another is given, which pictures find only beside the first."""
    other = EffectInstance.of("encoder_offset", "joint5", offset=0.003)
    asked = Channels(
        joints=lambda given: () if other.label in given else (OFFSET,),
        pictures=lambda given: (other,) if OFFSET.label in given else (),
    )
    found = asked.run()
    assert len(asked.asked) == len(set(asked.asked)), "each is asked each once"
    assert {e.label for e in found.world.effects} == {OFFSET.label, other.label}


RUBS = EffectInstance.of("coulomb_friction", "joint4", torque=1.0)


def test_a_partial_effect_that_its_channel_dropped_is_in_no_model_again():
    """One channel or several leave the same; what a channel leaves out of its own part it has not dropped."""
    model = ARM.add(OFFSET, *(replace(e, partial=True) for e in (FRICTION, RUBS)))
    contact, joints = (CHANNELS[name] for name in ("contact", "joints"))
    by_wrench = answer(contact.part(model).without(FRICTION.effect, FRICTION.where), (), "contact")
    by_joints = answer(joints.part(model), (), "joints")
    left = [OFFSET.label, RUBS.label]
    assert [e.label for e in with_rest(by_wrench, contact, model).world.effects] == left
    assert [e.label for e in joined([ChannelResult(contact, by_wrench, ())], model).world.effects] == left
    both = [ChannelResult(joints, by_joints, ()), ChannelResult(contact, by_wrench, ())]
    assert [e.label for e in joined(both, model).world.effects] == left
    found_elsewhere = ChannelResult(joints, answer(joints.part(model), (FRICTION,), "joints"), ())
    assert FRICTION in joined([found_elsewhere, ChannelResult(contact, by_wrench, ())], model).world.effects


def test_nobody_builds_on_what_is_not_certain():
    asked = Channels(joints=(replace(OFFSET, partial=True),))
    found = asked.run()
    assert all(OFFSET.label not in given for _, given in asked.asked)
    assert found.record["verdict"] == "unexplained" and found.record["unexplained"]


def test_the_page_and_the_terminal_have_every_channel(tmp_path):
    found = Channels(pictures=(CAMERA,), contact=(FRICTION,)).run()
    record = {**found.record, "provenance": {"command": "", "seed": 0, "versions": {}, "inputs": {}}}
    write_diagnosis(tmp_path, record, found.world, {})
    write_report(tmp_path, overwrite=True)
    page = (tmp_path / "report.html").read_text()
    for name in ("joints", "pictures", "contact"):
        assert f'id="channel-{name}"' in page
    assert "camera_offset<wbr>(wrist_wide)" in page and "contact_friction<wbr>(peg)" in page
    said = [block for block in diagnosis_summary(record) if "channel" in str(block).lower()]
    assert said
    old = {key: value for key, value in record.items() if key != "by_channel"}
    old |= {"rooms": [{"room": r["channel"], "given": r["given"], "record": r["record"]} for r in record["by_channel"]]}
    old["effects"] = [{"room": e["channel"], **{k: v for k, v in e.items() if k != "channel"}} for e in old["effects"]]
    (tmp_path / "diagnosis.json").write_text(json.dumps(old))
    write_report(tmp_path, overwrite=True)
    assert (tmp_path / "report.html").read_text() == page, "a record of the last release shows the same"


def test_what_several_channels_say_of_the_recordings_is_in_the_terminal_once():
    """Channels report the same missing readings and the same windows, and a contact's notes repeat them."""
    gap, long = "a: 3 readings of q.joint2 are missing", {"recording": "b", "said": "b: one window, from 4 s, is used"}
    told = []
    for name in ("joints", "pictures", "contact"):
        found = answer(ARM, (), name)
        found.record.update(missing=[gap, f"{name} are rare"], windows=[long])
        found.record.update({"evidence": "contact", "notes": [gap]} if name == "contact" else {})
        told.append(ChannelResult(CHANNELS[name], found, ()))
    record = joined(told, ARM).record
    assert record["missing"] == [gap, "joints are rare", "pictures are rare", "contact are rare"]
    assert record["windows"] == [long]
    printed = [block.text for block in diagnosis_summary(record) if isinstance(block, Line)]
    assert [printed.count(f"note: {line}") for line in (gap, long["said"], "joints are rare")] == [1, 1, 1]


def test_a_channel_that_was_left_out_is_named_once():
    """The record of the only channel left has the line under `missing`, for the terminal, and under `notes`."""
    line = "pictures are left out: no camera sees the cell"
    record = {**answer(ARM, (), "contact").record, "evidence": "contact", "missing": [line], "notes": ["slow", line]}
    printed = [block.text for block in diagnosis_summary(record) if isinstance(block, Line)]
    assert printed.count(f"note: {line}") == 1 and "note: slow" in printed


def test_what_the_encoders_misread_is_taken_off():
    scene = believed(ARM.cell).scene
    rec = Recording(Path("r"), "iiwa14", scene.joints, 100.0, Control(), np.arange(4) / 100, np.ones((4, 7)))
    q = CHANNELS["contact"].read(rec, ARM.add(OFFSET, CAMERA), How()).q
    assert np.allclose(q[:, 5], 1 - 0.004) and np.allclose(np.delete(q, 5, 1), 1.0) and (rec.q == 1).all()


def test_of_two_offsets_of_an_encoder_the_later_one_is_taken_off():
    """As the joints of a simulation read it, in either order."""
    every = EffectInstance.of("encoder_offset", "all", offset=0.01)
    scene = believed(ARM.cell).scene
    rec = Recording(Path("r"), "iiwa14", scene.joints, 100.0, Control(), np.arange(4) / 100, np.ones((4, 7)))
    for effects in ((every, OFFSET), (OFFSET, every)):
        read = effect("encoder_offset").observe(
            None, 0.0, 0.0, None, values(effect("encoder_offset"), [effects], scene)
        )
        np.testing.assert_allclose(CHANNELS["contact"].read(rec, ARM.add(*effects), How()).q, 1 - read[0].repeat(4, 0))


def test_what_the_wrench_weighed_is_what_the_arm_carries():
    from vispeg.robots.declared import carried

    scene = believed(ARM.cell).scene
    tool = {**carried(scene.nominal.compile())}
    rec = Recording(Path("r"), "iiwa14", scene.joints, 100.0, Control(), np.arange(4) / 100, np.ones((4, 7)), tool=tool)
    rec = replace(rec, cell=ARM.cell)
    assert carrying(rec, ARM.add(OFFSET)) is rec
    heavy = carrying(rec, ARM.add(EffectInstance.of("tool_mass", "gripper", mass=0.3)))
    assert heavy.tool["mass_kg"] == pytest.approx(tool["mass_kg"] + 0.3, abs=1e-6)
    assert heavy.tool["com_m"] != tool["com_m"]


@pytest.mark.parametrize("name", ["hole_offset", "hole_tilt", "grip_pose", "encoder_offset"])
def test_what_moves_a_picture_is_heeded_by_it(name):
    assert CHANNELS["pictures"].heeds(effect(name))


@pytest.mark.parametrize("name", ["contact_friction", "contact_stiffness", "payload", "camera_offset", "tool_mass"])
def test_what_does_not_is_not(name):
    assert not CHANNELS["pictures"].heeds(effect(name))


def test_a_channel_without_evidence_is_refused():
    from vispeg.api.diagnose import diagnose

    time = np.arange(400) / 100
    q = np.cumsum(np.random.default_rng(0).normal(size=(400, 7)), 0) * 1e-3
    joints = tuple(f"joint{k}" for k in range(1, 8))
    a = Recording(Path("a"), "iiwa14", joints, 100.0, Control("position", 100.0), time, q, q_cmd=q)
    b = replace(a, path=Path("b"), q=q + 1e-3)
    with pytest.raises(UserError, match="the model or one of the recordings does not have this channel"):
        diagnose("peg-cell", a, b, channels=("pictures",))
