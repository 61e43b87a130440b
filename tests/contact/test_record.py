"""The parts of a contact record: where it fails, from which values on an effect shows, what to record next."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import fits
import numpy as np
import pytest
from pressed import recorded

from vispeg.contact.errors.nuisance import Nuisance
from vispeg.contact.next_motion import separating
from vispeg.contact.picture import worst_moment
from vispeg.contact.record import arrays, not_excited, shows_from, where_it_fails, worst_left
from vispeg.contact.run import compare_contact, evidence_of
from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.findings import Gain, Rivals, Score, Trial
from vispeg.recordings.cell import CellBelief, WrenchSensor
from vispeg.worlds.world import World

FIXTURE = EffectInstance.of("fixture_compliance", "fixture", z=3e-5)


def test_an_error_of_contact_is_not_called_one_of_free_air():
    """What all blocks share is whitened away from a press and onto the rest; failures are each block's own."""
    evidence = evidence_of([recorded((FIXTURE,))])
    (item,) = evidence.items
    predicted = [item.measured[None].copy()]
    pressed, free = (item.phase.of(name) & item.valid[:, 2] for name in ("press", "free"))
    predicted[0][0, pressed, 2] -= 3.0 * item.sigma[pressed, 2]
    evidence.nuisance = Nuisance.of(5.0 * (item.valid & (np.arange(6) == 2)).astype(float).reshape(-1, 1))
    spread = evidence.whitened([predicted[0][0]])[0]
    assert np.sum(spread[free] ** 2) > 0.1 * np.sum(spread[pressed] ** 2) > 0, "which the test of an effect allows for"
    assert where_it_fails(evidence, predicted) == [{"joint": "force z", "regime": "press", "share": 1.0}]
    assert str(arrays(evidence, predicted)["worst/moment"]).endswith("press")


def test_the_error_is_the_rms_of_the_plotted_difference():
    """Plain newtons, measured less model, of all that is drawn; no allowance for a sensor's zero or a path is in it."""
    compared = compare_contact(World(), [recorded((FIXTURE,))])
    drawn = compared.arrays["0/measured"] - compared.arrays["0/before"]
    plain = float(np.sqrt(np.nanmean(drawn**2)))
    assert compared.record["ladder"][0]["heldout_error"] == pytest.approx(plain, rel=1e-12)
    axes = [row["error"] for row in compared.record["joints"][:3]]
    assert plain == pytest.approx(np.sqrt(np.mean(np.square(axes))), rel=1e-9), "and what each axis says"


def test_the_largest_residual_is_stated_with_its_phase_time_and_place():
    evidence = evidence_of([recorded((FIXTURE,))])
    (item,) = evidence.items
    predicted = [np.repeat(item.measured[None], 2, axis=0)]
    block = int(np.flatnonzero(item.phase.of("slide") & item.valid[:, 2])[5])
    predicted[0][1, block, 2] -= 2.0
    worst = worst_left(evidence, predicted)
    assert worst["phase"] == "slide" and worst["force"] == pytest.approx(2.0)
    assert worst["time_s"] == pytest.approx(item.segment.time[block], abs=0.01)
    x, y, z = worst["tip_m"]
    assert x == pytest.approx(0.03, abs=2e-3) and abs(y) < 0.021 and abs(z) < 2e-3, "it slides beside the hole"


def test_the_place_and_the_posture_of_the_worst_moment_are_told_where_an_angle_was_not_read():
    rec = recorded((FIXTURE,))
    told = []
    for _ in range(2):
        evidence = evidence_of([rec])
        (item,) = evidence.items
        predicted = [item.measured[None].copy()]
        block = int(np.flatnonzero(item.phase.of("slide") & item.valid[:, 2])[5])
        predicted[0][0, block, 2] -= 20.0
        told.append((worst_left(evidence, predicted), arrays(evidence, predicted)["worst/q"]))
        q = rec.q.copy()
        q[item.segment.rows[block], 1] = np.nan
        rec = replace(rec, q=q)
    (whole, posture), (worst, bridged) = told
    assert worst["time_s"] == whole["time_s"]
    np.testing.assert_allclose(worst["tip_m"], whole["tip_m"], atol=1e-4)
    np.testing.assert_allclose(bridged, posture, atol=1e-3)


def test_the_worst_moment_is_none_in_which_contact_ends():
    """A block that begins in contact and ends in free air holds a part of the former over the floor of the latter."""
    evidence = evidence_of([recorded((FIXTURE,))])
    (item,) = evidence.items
    predicted = [item.measured[None].copy()]
    pressed = item.phase.of("press") & item.valid[:, 2]
    free = item.phase.of("free")
    leaving = int(np.flatnonzero(free & (np.roll(~free, 1) | np.roll(~free, -1)) & item.valid[:, 2])[0])
    predicted[0][0, pressed, 2] -= 3.0 * item.sigma[pressed, 2]
    predicted[0][0, leaving, 2] -= 30.0 * item.sigma[leaving, 2]
    assert str(arrays(evidence, predicted)["worst/moment"]).endswith("press")


def test_a_tared_sensor_leaves_what_a_raw_one_leaves_in_every_phase():
    """The rest, in which a tared sensor reads nothing in every model, is not compared: the tool weighs 8 N."""
    raw = recorded((FIXTURE,))
    tared = replace(raw, ft=raw.ft - raw.ft[:100].mean(axis=0), wrench=WrenchSensor(tared=True))
    rows, others = (compare_contact(World(), [rec]).record["phases"] for rec in (raw, tared))
    assert [row["phase"] for row in rows] == [row["phase"] for row in others]
    for row, other in zip(rows, others, strict=True):
        assert other["before"] == pytest.approx(row["before"], rel=0.1, abs=0.02)
        assert other["seconds"] <= row["seconds"]


def test_an_effect_is_said_to_show_from_values_that_it_may_have():
    """A compliance and a delay are none or more; a pose, a gain and a scale have two sides."""
    least = {
        ("fixture_compliance", "fixture"): {"x": np.inf, "z": 2e-5},
        ("wrench_delay", "flange"): {"delay": 0.012},
        ("hole_offset", "fixture"): {"z": 4e-4},
        ("contact_friction", "peg"): {"scale": 1.5},
        ("contact_stiffness", "peg"): {"scale": 2.0},
    }
    between = {(row["effect"], k): ends for row in shows_from(least) for k, ends in row["between"].items()}
    assert between["fixture_compliance", "x"] is None
    assert between["fixture_compliance", "z"] == (0.0, 2e-5) and between["wrench_delay", "delay"] == (0.0, 0.012)
    assert between["hole_offset", "z"] == (-4e-4, 4e-4)
    assert between["contact_friction", "scale"] == (0.0, 2.5), "no friction pulls"
    assert between["contact_stiffness", "scale"] == (0.5, 2.0)


FIXED = World().add(FIXTURE)
ARM, SOFT = EffectInstance.of("arm_compliance", "all"), EffectInstance.of("contact_stiffness", "peg")
DULL = [{"effect": "hole_clearance", "where": "fixture", "why": "", "motion": "insert"}]


def rivals(*equals: EffectInstance) -> list[Rivals]:
    worlds = [World().add(e) for e in equals]
    gain = Gain(0.0, 0.0, 0.0)
    trials = tuple(Trial(Score(w.effects[0], 0.0), fits.fit(w), np.zeros((1, 3)), gain) for w in worlds)
    return [Rivals(FIXTURE.label, trials, trials)]


@pytest.mark.parametrize(
    ("equals", "recorded", "motion"),
    [
        ((ARM,), {"press"}, "touch-datum"),
        ((ARM, SOFT), {"press", "touch-datum"}, "hard-press"),
        ((ARM,), {"press", "touch-datum"}, "touch-datum again, with more force, at other places"),
        ((), {"press"}, "insert"),
        ((), {"insert"}, "insert again, with more force against the walls"),
    ],
)
def test_a_motion_that_is_recorded_is_asked_for_only_where_no_other_separates_and_then_otherwise(
    equals, recorded, motion
):
    asked = separating(FIXED, rivals(*equals), DULL, (), recorded)
    assert asked["motion"] == motion
    assert (" as it was recorded does not" in asked["why"]) == ("again" in motion)


def test_what_was_not_excited_is_asked_for_by_a_motion_that_is_not_recorded():
    """A clearance shows in an insertion and where the part is rocked; if both are recorded, in another insertion."""
    silent = {("hole_clearance", "fixture"): {"width": np.inf}, ("hole_tilt", "fixture"): {"roll": 0.01}}
    asked = [not_excited(silent, recorded) for recorded in ((), ("insert",), ("insert", "rock"))]
    assert [[u["motion"] for u in rows] for rows in asked] == [["insert"], ["rock"], ["insert"]]
    assert effect("hole_clearance").shown_by == ("insert", "rock")


def test_the_picture_shows_the_cell_of_the_recording_that_it_names():
    """`rig-10` begins as `rig-1` does, whose cell is another."""
    near, far = (replace(recorded(), cell=CellBelief("nominal", {"fixture": [x, 0.0, 0.05]})) for x in (0.5, 0.62))
    first, tenth = replace(near, path=Path("rig-1")), replace(far, path=Path("rig-10"))
    worst = {"worst/recording": np.array("rig-10"), "worst/q": first.q[0]}
    shown = [worst_moment(worst, some) for some in ((first, tenth), (tenth, first), (tenth,), (first,))]
    if not shown[0]:
        pytest.skip("no renderer works here")
    pictures = [some["worst/png"].tobytes() for some in shown]
    assert pictures[0] == pictures[1] == pictures[2] != pictures[3]
