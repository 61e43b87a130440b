"""Two states of one robot: what both have is the arm, what differs is the change, named with its size."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from loops import ARM, SWING, WEIGHT, pendulum

import vispeg
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.identify.inverse import TorqueEvidence
from vispeg.recordings.recording import Control, Recording
from vispeg.report.evidence import Evidence
from vispeg.report.record import Record
from vispeg.report.sections import found as found_section
from vispeg.report.text import words
from vispeg.worlds.world import World

EMPTY = (
    EffectInstance.of("coulomb_friction", "shoulder", torque=0.4),
    EffectInstance.of("coulomb_friction", "elbow", torque=0.3),
    EffectInstance.of("link_mass", "upper", mass=0.5),
)
LOAD = EffectInstance.of("payload", "flange", mass=0.6, z=-0.02)


WORN = (EMPTY[0], EffectInstance.of("coulomb_friction", "elbow", torque=0.75), EMPTY[2])


def measured(path: Path, effects, seeds) -> list[Recording]:
    """Return torques of an arm with these effects, each recording on a motion of its own."""
    out = []
    for i in seeds:
        t, w = np.arange(1600) * 5e-3, 1 + 0.1 * i
        q = np.stack([0.6 * np.sin(2.5 * w * t) + 0.3 * np.sin(6 * t), 0.8 * np.sin(4 * w * t + i)], axis=1)
        rec = Recording(Path(f"r{i}"), str(path), ("shoulder", "elbow"), 200.0, Control("unknown", 200.0), t, q)
        rec = replace(rec, tau=0 * q, torque_sensor="motor", noise={"tau": 0.02})
        ideal, tau = TorqueEvidence([rec]), np.zeros_like(q)
        tau[ideal.items[0].segment.rows] = ideal.simulated([World().add(*effects)])[0][0]
        out.append(replace(rec, tau=tau + 0.02 * stream(i, "tau").standard_normal(q.shape)))
    return out


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """The arm's file, and three recordings of it empty."""
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    return path, measured(path, EMPTY, range(3))


def changed(arm, effects):
    """Return the diagnosis of what changed from the empty arm to one with these effects."""
    path, empty = arm
    now = measured(path, effects, range(3, 6))
    found = vispeg.diagnose(World(str(path)), now[:2], now[2:], baseline=empty, threads=1)
    assert {(e["effect"], e["where"]) for e in found.record["baseline"]["effects"]} == {
        (e.effect, e.where) for e in EMPTY
    }
    assert found.record["ladder"][-1]["heldout_error"] < 1.1 * 0.02
    return found


def sizes(found) -> dict[tuple[str, str], tuple[float | None, float]]:
    """Return the first value of each effect of the change, before and now."""
    out = {}
    for e in found.record["effects"]:
        (name, now), *_ = e["params"].items()
        out[e["effect"], e["where"]] = e["was"][name]["value"] if "was" in e else None, now["value"]
    return out


def test_a_payload_is_the_change_and_friction_is_the_arm(arm):
    found = changed(arm, (*EMPTY, LOAD))
    assert sizes(found) == {("payload", "flange"): (None, pytest.approx(0.6, rel=0.02))}
    assert "New: Payload" in words.baseline(found.record) and "Changed" not in words.baseline(found.record)


def test_a_joint_that_runs_harder_is_the_change_and_not_another_effect_that_imitates_it(arm):
    """Its friction is in the arm already, so that a search that only adds names something else in that joint."""
    found = changed(arm, WORN)
    assert found.verdict == "identified"
    assert sizes(found) == {
        ("coulomb_friction", "elbow"): (pytest.approx(0.3, rel=0.02), pytest.approx(0.75, rel=0.01))
    }
    assert "Changed: Coulomb friction at elbow (from 0.30" in words.baseline(found.record)
    assert [e for e in found.world.effects if e.label == "coulomb_friction(elbow)"] == [*found.effects]
    (row,) = found_section.effect_rows(Record("diagnosis", found.record, Evidence()))
    assert row["remark"].endswith("N m before")


def test_what_is_new_and_what_has_changed_are_told_apart(arm):
    found = changed(arm, (*WORN, LOAD))
    assert sizes(found) == {
        ("coulomb_friction", "elbow"): (pytest.approx(0.3, rel=0.02), pytest.approx(0.75, rel=0.02)),
        ("payload", "flange"): (None, pytest.approx(0.6, rel=0.02)),
    }


def test_an_arm_that_has_not_changed_has_no_change(arm):
    found = changed(arm, EMPTY)
    assert found.verdict == "adequate" and not found.record["effects"]
    assert words.baseline(found.record).endswith("No change was found.")


def test_a_baseline_needs_a_recording_to_judge_on(arm):
    path, empty = arm
    with pytest.raises(UserError, match="another must judge"):
        vispeg.diagnose(World(str(path)), empty[1], empty[2], baseline=empty[:1])


def test_a_change_keeps_what_joints_do_not_show_and_states_all_inputs():
    """A pendulum that is as its model says, before and after; its model also has effects that cameras alone see."""
    robot, t, recordings = pendulum(), np.arange(1600) * 5e-3, []
    for i, name in enumerate(["d", "b", "c", "a"]):
        w = 2.0 + 0.4 * i
        q = 0.8 * np.sin(w * t)[:, None]
        tau = -SWING * w**2 * q + WEIGHT * np.sin(q) + 0.02 * stream(i, "pendulum").standard_normal(q.shape)
        rec = Recording(Path(name), robot.source, robot.joints, 200.0, Control("unknown", 200.0), t, q, tau=tau)
        recordings.append(replace(rec, torque_sensor="motor", noise={"tau": 0.02}))
    world = World(robot.source).add(
        EffectInstance.of("brightness", "external", change=0.2), EffectInstance.of("background", "all")
    )
    found = vispeg.diagnose(world, recordings[2], recordings[3], baseline=recordings[:2], threads=1)
    assert found.verdict == "adequate" and found.world.effects == world.effects
    assert list(found.record["provenance"]["inputs"]) == ["a", "b", "c", "d"]
