"""Blows: run again from just before each, they tell the damping of a contact, and nothing else names it."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from vispeg.api.recording.contact import check_contact
from vispeg.contact.again.blows import blows, predicted
from vispeg.contact.again.damping import struck
from vispeg.contact.run import evidence_of
from vispeg.contact.selection.profile import place_of, places
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.seeds import stream
from vispeg.effects.common.parts import shapes
from vispeg.effects.contact.restitution import ratio
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.noise import NOISE
from vispeg.robots.tools import CELL
from vispeg.sim.compiled import compiled
from vispeg.task.belief import believed
from vispeg.task.rig.commanded import CellMotion
from vispeg.task.rig.motions import Place
from vispeg.task.rig.path import commands
from vispeg.task.rig.record import record_cell
from vispeg.worlds.world import World

MODEL = World("iiwa14", CELL, cell=CellBelief("nominal"))
FOUND = believed(MODEL.cell)
PLACE = Place(FOUND.scene, stream(1, "blows"))


@lru_cache
def tapped(seed, *hidden):
    """Three taps at 15 to 40 mm/s, 3.5 s."""
    path = PLACE.begin(0.012)
    for k, speed in enumerate((0.035, 0.012, 0.03)):
        x, y = PLACE.aside * np.cos(k + seed), PLACE.aside * np.sin(k + seed)
        path.to(0.3, tip=(x, y, 0.006)).to(0.009 / speed, "even", tip=(x, y, -0.003)).to(0.1).to(0.2, tip=(x, y, 0.006))
    time, frames = path.frames(500.0)
    made = CellMotion("tap", time, commands(frames, FOUND.scene, FOUND.config.stiffness))
    return record_cell(MODEL.add(*map(placed, hidden)), made, NOISE, stream(seed, "blows"))


def placed(text):
    """Of the peg, `EFFECT:param=value`."""
    name, _, value = text.partition(":")
    param, _, number = value.partition("=")
    return EffectInstance.of(name, "peg", **{param: float(number)})


def test_a_blow_run_again_in_the_true_world_has_the_measured_impulse_and_flight():
    """Within the stated share; with ten times less damping it has not."""
    truth, wrong = World(), World().add(placed("contact_damping:scale=0.1"))
    found = blows(tapped(1))
    assert len(found) == 3 and [round(b.speed, 2) for b in found] == pytest.approx([0.035, 0.012, 0.03], abs=0.01)
    scores = np.array([[np.abs(b.felt - f) / b.sigma for f in predicted(b, [truth, wrong])] for b in found])
    assert np.sqrt(np.mean(scores[:, 0] ** 2)) < 1.0 < 2.0 < np.sqrt(np.mean(scores[:, 1] ** 2))


def test_a_missing_reading_before_a_blow_does_not_move_its_start():
    """The gap is bridged: the start is the one of all readings, to their noise."""
    rec = tapped(1)
    first, *_ = blows(rec)
    q = rec.q.copy()
    q[first.rows.start - 5, 3] = np.nan
    found, *_ = blows(replace(rec, q=q))
    for got, expected, limit in zip(found.start, first.start, (1e-4, 1e-2), strict=True):  # rad, rad/s
        np.testing.assert_allclose(got, expected, atol=limit)


def nominal_ratio():
    """Damping ratio of the peg's contacts."""
    return compiled(FOUND.scene).geom_solref[shapes(compiled(FOUND.scene), "peg")[0], 1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "true"),
    [("contact_damping:scale=0.2", 0.2), ("restitution:e=0.5", ratio(np.array(0.5)) / nominal_ratio())],
    ids=["damping", "restitution"],
)
def test_damping_and_restitution_are_named_as_one_number_from_taps(hidden, true):
    found = struck(World(), [tapped(1, hidden)], [tapped(2, hidden)])
    (named,) = found.effects
    got = named.params["scale"]
    assert got.low is not None and got.high is not None
    assert named.label == "contact_damping(peg)" and got.low <= true <= got.high
    assert got.high < 0.6 and "restitution" in found.notes[0]


@pytest.mark.slow
def test_nothing_is_named_where_damping_is_nominal_or_something_else_is_softer():
    assert not struck(World(), [tapped(1)], [tapped(2)]).effects
    soft = "contact_stiffness:scale=0.1"
    found = struck(World(), [tapped(1, soft)], [tapped(2, soft)])
    assert not found.effects and "by 0 ms RMS" in found.notes[0], "a soft contact throws back as much"
    beside = struck(World().add(placed(soft)), [tapped(1, soft)], [tapped(2, soft)])
    assert not beside.effects and "fit them" in beside.notes[0], "nor beside what was found"


def test_damping_within_what_another_law_explains_is_told_but_not_named():
    mild = "contact_damping:scale=0.6"
    found = struck(World(), [tapped(1, mild)], [tapped(2, mild)])
    assert not found.effects and "fit them" in found.notes[0] and "no damping" not in found.notes[0]


def test_damping_that_fits_but_is_not_in_the_held_out_impacts_is_not_named_for_that_reason():
    found = struck(World(), [tapped(1, "contact_damping:scale=0.2")], [tapped(2)])
    assert not found.effects and found.notes[0].endswith("but it does not improve the held-out impacts: not named")


def test_a_wrench_along_a_path_never_names_it_and_without_blows_it_is_not_excited():
    rec = tapped(1)
    air = rec.time < 1.0
    cut = {k: getattr(rec, k)[air] for k in ("time", "q", "dq", "tau", "ee", "ee_cmd", "ft")}
    free = replace(rec, **cut)
    (unseen,) = struck(World(), [free], [rec]).unseen
    assert unseen["effect"] == "contact_damping" and unseen["motion"] == "tap" and "nothing was hit" in unseen["why"]
    offered = {name for name, _ in places(evidence_of([rec]), World())}
    assert "contact_damping" not in offered and "contact_stiffness" in offered
    assert place_of(effect("contact_damping"), FOUND.scene) == "peg"


def test_check_and_diagnosis_give_one_reason_why_damping_is_not_excited():
    """A check says that damping is excited exactly where a diagnosis looks for it, and both give the same reason."""
    tap = tapped(1)
    unknown = replace(tap, control=replace(tap.control, mode="unknown"))
    begin = int(1.1 * tap.rate_hz)
    parts = {name: getattr(tap, name)[:begin] for name in ("time", "q", "dq", "tau", "ee", "ee_cmd", "ft")}
    quiet = replace(tap, **parts)
    for rec in (unknown, quiet):
        (unseen,) = struck(World(), [rec], [rec]).unseen
        assert unseen["why"] == check_contact(rec)[0].excited["contact_damping"] != ""
    (unseen,) = struck(World(), [tap], [quiet]).unseen
    assert check_contact(tap)[0].excited["contact_damping"] == ""
    assert unseen["why"].endswith("in the held-out recordings")
