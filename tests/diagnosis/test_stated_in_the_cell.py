"""Effects that a recording's cell states: pictures are taken, compared, checked and diagnosed with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vispeg.api.recording.record import record
from vispeg.channels.channel import CHANNELS, How
from vispeg.channels.pictures import border_evidence_of, compared_pictures
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.noise import NOISE
from vispeg.task import belief
from vispeg.vision.check import check_frames
from vispeg.vision.compare import border_rms
from vispeg.vision.geometry import Geometry
from vispeg.worlds.world import World

OPEN = World("iiwa14", "meg50+peg16", cell=CellBelief("peg-cell"))
WRIST, MOVED, TRUE = "wrist_wide", 0.02, 0.006  # m: of the fixture and of the camera, along x


def cell(fixture: float = MOVED, camera: float = TRUE) -> CellBelief:
    """A cell that states how far fixture and camera are from their nominal places, m."""
    stated = (("hole_offset", "fixture", fixture), ("camera_offset", WRIST, camera))
    return CellBelief("nominal", effects=tuple({"effect": e, "where": at, "params": {"x": x}} for e, at, x in stated))


@pytest.fixture(scope="module")
def recorded():
    """Two recordings in that cell."""
    world = replace(OPEN, cell=cell())
    how = {"cameras": WRIST, "size": "160x120", "fps": 0.5, "rate_hz": 100.0, "noise": dict.fromkeys(NOISE, 0.0)}
    return [record(world, "look", seed=k, name=f"l{k}", **how).recording for k in (1, 2)]


@pytest.mark.slow
def test_compare_check_and_diagnosis_have_a_stated_fixture_where_a_cell_that_is_built_there_has_it(recorded):
    rec, found = recorded[0], []
    built = replace(cell(0.0), task={"fixture": [0.6 + MOVED, 0.0, 0.05]})
    for stated in (cell(), built, cell(0.0)):
        one = replace(rec, cell=stated)
        evidence, _ = border_evidence_of(OPEN, [one], [])
        (checked,) = check_frames(one, belief.scene_of(OPEN, one))
        compared = border_rms(compared_pictures(one, OPEN))
        found.append([compared, *evidence.errors([OPEN]), *checked.distance, checked.softness])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-3)
    assert found[0][0] < 0.5 and found[2][0] > 1.0
    assert not np.isclose(found[0][2:], found[2][2:], rtol=0.01).all()


def test_an_effect_of_the_model_stands_in_for_the_stated_one(recorded):
    world, places = OPEN.add("hole_offset", "fixture", x=0.005), []
    evidence, _ = border_evidence_of(world, recorded[:1], [])
    for geometry in (evidence.geometry, Geometry(belief.scene_of(world, recorded[0]), [])):
        for model in (OPEN, world):
            geometry.place(model)
            places.append(geometry.bodies["fixture"][0])
    np.testing.assert_allclose(places, 2 * [0.6 + MOVED, 0.605])


@pytest.mark.slow
def test_a_diagnosis_finds_nothing_where_the_cell_states_all(recorded):
    found = CHANNELS["pictures"].diagnose(OPEN, (recorded[:1], recorded[1:]), How())
    assert found.record["verdict"] == "adequate" and not found.world.effects, found.record["reason"]


@pytest.mark.slow
def test_a_stated_effect_of_another_size_is_named_at_its_whole_size_and_counts_once(recorded):
    some = [replace(rec, cell=cell(camera=0.001)) for rec in recorded]
    found = CHANNELS["pictures"].diagnose(OPEN, (some[:1], some[1:]), How())
    (placed,) = found.world.effects
    assert (placed.effect, placed.where) == ("camera_offset", WRIST)
    assert abs(placed.params["x"].value - TRUE) < 3e-4
    assert border_rms(compared_pictures(some[1], found.world)) < 0.5 < border_rms(compared_pictures(some[1], OPEN))
