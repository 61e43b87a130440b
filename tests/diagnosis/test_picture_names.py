"""What a picture's effect has to do to be a name: something that no others do, alike in two recordings."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import fits
import numpy as np
import pytest
from border_points import WRIST, points_at, seen

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.diagnosis.findings import Gain, Score, Trial
from vispeg.diagnosis.pictures.borders import Agreement, BorderSearch, agreement
from vispeg.diagnosis.selection.state import State
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.identify.pictures.points import Item, misplacement
from vispeg.identify.pictures.scatter import Scatter
from vispeg.worlds.world import World

POINTS = 60


def offset(x: float) -> World:
    return World().add(EffectInstance.of("camera_offset", WRIST, x=x))


@lru_cache
def evidence(x: float = 0.003) -> BorderEvidence:
    """Border points 0.2 to 1 m from a camera that is off by x in m, as their edges say; one of 1 mm is not trusted."""
    rng = stream(1, "borders")
    geometry, sight = seen((320, 240))
    turn = rng.uniform(0.0, 2.0 * np.pi, POINTS)
    points = points_at(
        geometry, rng.uniform([20, 20], [300, 220], (POINTS, 2)), np.stack([np.cos(turn), np.sin(turn)], axis=1),
        np.r_[1e-3, rng.uniform(0.2, 1.0, POINTS - 1)],
    )  # fmt: skip
    edges = replace(points, along=-misplacement(geometry, sight, offset(x), points))
    edges.along[0] = 40.0  # the edge of something else
    item = Item(sight, edges, np.r_[0.0, np.ones(POINTS - 1)], np.array([0.1]))
    return BorderEvidence(geometry, [item], World(), Scatter(0.0, 0.0))


def test_an_effect_is_doubted_if_others_explain_it_or_two_recordings_differ():
    assert Agreement(1.0, 0.1).doubt(0.2) == ""
    assert "other effects imitate" in Agreement(0.19, 0.0).doubt(0.2)
    assert "between two recordings" in Agreement(0.4, 0.21).doubt(0.2)


def test_agreement_compares_the_differences_that_an_effect_makes_in_two_recordings():
    """A camera that moves by dx along its rows moves what is z before it by f dx / z."""
    fitted, judged = evidence(0.004), evidence(0.003)
    said = agreement(BorderSearch(fitted, judged), offset(0.004), World(), 0)
    (item,), (eye,) = judged.items, judged.geometry.eyes.values()
    each = eye.camera.K[0, 0] * item.points.normal[1:, 0] / item.points.depth[1:]  # px for 1 m
    assert said.size == pytest.approx(0.004 * np.sqrt(np.mean(each**2)), rel=0.01)
    assert said.apart == pytest.approx(0.001 * np.sqrt(np.mean(each**2)), rel=0.02)


class Doubting(BorderSearch):
    """A search that doubts every delay of a camera."""

    def doubt(self, placed, added, without, n_fixed):
        """Doubt what is no offset."""
        return "others do it" if placed.effect == "camera_delay" else ""


def test_the_first_name_that_is_not_doubted_comes_first_and_says_why_the_others_are():
    search, trials = Doubting(evidence(), evidence()), []
    for name, rejected in (("camera_delay", ""), ("camera_offset", ""), ("focal_error", "x")):
        world = World().add(EffectInstance.of(name, WRIST))
        score = Score(world.effects[0], 0.0)
        trials.append(Trial(score, fits.fit(world), np.zeros((1, 1)), Gain(0.0, 0.0, 0.0), rejected))
    order = search.questioned(State(World(), np.zeros((1, 1)), np.zeros(1), 0), trials)
    assert [t.score.placed.effect for t in order] == ["camera_offset", "focal_error", "camera_delay"]
    assert [t.rejected for t in order] == ["", "x", "others do it"]


def test_an_effect_that_only_motion_shows_needs_fewer_pixels():
    search = BorderSearch(evidence(), evidence())
    late, off = (EffectInstance.of(name, WRIST) for name in ("camera_delay", "camera_offset"))
    assert search.least_of(late) == RULES.moving_px < search.least_of(off) == RULES.shift_px
