"""What errors of sensor, path and form may take of a residual, and that it hides nothing that is asked for."""

from __future__ import annotations

import numpy as np
import pytest
from pressed import recorded
from scipy.spatial.transform import Rotation

from vispeg.contact.drive import drive
from vispeg.contact.errors.nuisance import FORM, KINDS, PATH, READING, Nuisance, _misplaced
from vispeg.contact.record import allowed, with_nuisance
from vispeg.contact.run import evidence_of
from vispeg.contact.selection.spare import too_small
from vispeg.contact.sensor import hand_world, true_wrench
from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.diagnosis.findings import Verdict
from vispeg.worlds.world import World

SOFT = EffectInstance.of("fixture_compliance", "fixture", z=1e-5)


def test_a_contact_takes_up_what_a_sensor_misreads():
    """In free air all of a wrong reading is left; against a surface next to nothing; along it, where it slides, all."""
    item = evidence_of([recorded()]).items[0]
    used = item.phase.valid & ~item.phase.resting
    free, press = (np.median(item.reading_response[item.phase.of(name) & used], axis=0) for name in ("free", "press"))
    np.testing.assert_allclose(free, np.eye(6), atol=0.05)
    assert abs(press[2, 2]) < 0.1
    slide = item.reading_response[item.phase.of("slide") & used]
    assert np.median(slide[:, 2, 2]) < 0.3 and np.median(np.abs(slide[:, :2, :2]).sum(axis=(1, 2))) > 0.7


def test_an_error_of_the_path_pushes_in_contact_and_in_free_air_as_a_hand_driven_along_it():
    """It presses by the stiffness and pulls by mass times false acceleration; a column of the covariance has both."""
    item = evidence_of([recorded()]).items[0]
    path, phase, world = item.path, item.phase, [World()]
    turn = 2 * np.pi * 2.0  # rad/s, of a height that swings up and down, base z
    size = RULES.kinematics_place * np.array([0.0, 0.0, 1.0])
    swing = np.stack([np.sin(turn * path.time), turn * np.cos(turn * path.time)])[..., None]
    off = np.zeros((1, 2, len(path.time), 6))
    off[0, :, :, :3] = swing * Rotation.from_quat(path.frame, scalar_first=True).inv().apply(size)
    wrench = true_wrench(path, hand_world(item.source.believed, World()))[None]
    given = (item.armless, item.source.scene, path, world, wrench, phase.rest, phase.windows, 1)
    with_error, without = drive(*given, deviation=lambda _: off), drive(*given)
    change = phase.means(with_error.correction - without.correction)[0, :, 2]
    column = _misplaced(item, np.sin(turn * phase.time)[:, None])[2][:, 2]
    for some in (phase.of("free") & ~phase.near, phase.of("press")):
        some = some & phase.used
        assert some.sum() >= 4
        assert change[some] @ column[some] == pytest.approx(column[some] @ column[some], rel=0.3)


def test_errors_of_a_sensor_hide_no_compliance():
    """10 um/N is 2 % of a press to the hold's springs, no more than crosstalk: what the path cannot be off by stays."""
    evidence = evidence_of([recorded((SOFT,))])
    worlds = [World(), World().add(SOFT)]
    as_read = [evidence.as_read(w) for w in worlds]
    left = [float(r @ r) for r in evidence.residuals(worlds)]
    assert left[0] - left[1] > 0.07 * (as_read[0] - as_read[1]) > 0


def test_each_kind_of_error_explains_its_own_residual():
    """Each of its own usual size: of what is one kind's alone that kind takes all but a noise variance."""
    rng = stream(5, "allowed")
    columns, kinds = 30.0 * rng.standard_normal((400, 6)), np.repeat([READING, PATH, FORM], 2)
    errors = Nuisance.of(columns, kinds)
    for kind in (READING, PATH, FORM):
        residual = columns[:, kinds == kind] @ rng.standard_normal(2) + rng.standard_normal(400)
        taken = errors.taken(residual)
        assert taken[KINDS[kind]] > 0.95 and all(v < 0.05 for k, v in taken.items() if k != KINDS[kind])
    assert max(errors.taken(rng.standard_normal(400)).values()) < 0.05


def test_a_verdict_states_the_share_that_a_nuisance_explains():
    evidence = evidence_of([recorded((SOFT,))])
    (row,) = allowed(evidence, {"given": World()})
    assert row["model"] == "given" and all(0 <= row[kind] <= 1 for kind in KINDS)
    verdict = Verdict("adequate", "nothing lowers it")
    most = {"model": "given", "sensor": 0.1, "path": 0.8, "form": 0.0}
    assert "explain 80 %" in with_nuisance(verdict, [most]).reason and "0.2 mm" in with_nuisance(verdict, [most]).reason
    assert with_nuisance(verdict, [{**most, "path": 0.2}]) == verdict


@pytest.mark.parametrize(
    ("values", "small"), [({"z": 1e-5}, True), ({"z": 3e-5}, False), ({"z": 1e-5, "x": 5e-5}, False)]
)
def test_an_effect_under_the_size_that_shows_is_too_small(values, small):
    least = {("fixture_compliance", "fixture"): {"x": 4e-5, "z": 2e-5, "roll": np.inf}}
    assert too_small(EffectInstance.of("fixture_compliance", "fixture", **values), least) is small
    assert not too_small(EffectInstance.of("hole_tilt", "fixture", roll=1e-3), least), "of what size shows nobody knows"


def test_a_factor_shows_from_so_many_times_and_a_share_from_so_much():
    least = {("object_mass", "peg"): {"scale": 1.5}, ("contact_friction", "peg"): {"scale": 0.5}}
    for name, sizes in (("object_mass", (1.3, 0.7, 1.6, 0.6)), ("contact_friction", (1.3, 0.7, 1.6, 0.4))):
        told_ = [too_small(EffectInstance.of(name, "peg", scale=scale), least) for scale in sizes]
        assert told_ == [True, True, False, False]
