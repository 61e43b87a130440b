"""What a size of an effect gains beside others: as much as if their parameters were fitted anew to it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from vispeg.contact.selection.profile import probed
from vispeg.contact.selection.screen import Screen
from vispeg.contact.selection.search import ContactSearch
from vispeg.contact.thin import PART
from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.diagnosis.progress import Progress
from vispeg.identify.space import Freedom
from vispeg.worlds.world import World

OFFSET, GRIP = ("hole_offset", "fixture"), ("grip_pose", "peg")


class Straight(Freedom):
    """A residual that is linear in a hole's x and y and in a grip's x, which acts nearly as the hole's x does."""

    def __init__(self):
        rng = stream(1, "straight")
        self.hole = 1e5 * rng.standard_normal((60, 2))
        self.grip = self.hole[:, 0] + 3e4 * rng.standard_normal(60)
        self.hidden = 2e-3 * self.grip + rng.standard_normal(60)

    def frees(self, kind, name):
        return name in ("x", "y") if kind.name == "hole_offset" else name == "x"

    def residuals(self, worlds):
        return [self.residual({e.effect: e.params for e in w.effects}) for w in worlds]

    def residuals_in_part(self, worlds):
        return [r / PART**0.5 for r in self.residuals(worlds)]

    def residual(self, params):
        hole, grip = params.get("hole_offset"), params.get("grip_pose")
        out = self.hidden.copy()
        if hole:
            out -= self.hole @ [hole["x"].value, hole["y"].value]
        return out - self.grip * grip["x"].value if grip else out


def test_beside_an_effect_another_gains_what_both_fitted_together_do():
    """The hole's offset alone stands for the grip's; beside it, as it is, no size of the grip's x gains anything."""
    evidence = Straight()
    alone, *_ = np.linalg.lstsq(evidence.hole, evidence.hidden, rcond=None)
    world = World().add(EffectInstance.of(*OFFSET, x=alone[0], y=alone[1]))
    before = float(np.sum(evidence.residuals([world])[0] ** 2))
    as_it_is = {p.placed.params["x"].value: p.gain for p in probed(evidence, world, [GRIP]) if p.name == "x"}
    anew = {p.placed.params["x"].value: p for p in probed(evidence, world, [GRIP], free=[0]) if p.name == "x"}
    assert max(as_it_is.values()) < 0.1 * before
    for size, probe in anew.items():
        rest = evidence.hidden - evidence.grip * size
        fitted, *_ = np.linalg.lstsq(evidence.hole, rest, rcond=None)
        after = float(np.sum((rest - evidence.hole @ fitted) ** 2))
        assert probe.gain == pytest.approx(before - after, rel=1e-6)
    assert max(p.gain for p in anew.values()) > 0.5 * before


class Threshold(Freedom):
    """A grip that slips under each of 60 forces up to 110 N beyond 120 N times its scale: the greatest count most."""

    def __init__(self):
        self.force = np.linspace(0.0, 110.0, 60)
        self.size = np.where(self.force > 72.0, 30.0, 8.0)
        self.hidden = self.slipped(0.3)

    def slipped(self, grip):
        return np.where(self.force > 120.0 * grip, self.size, 0.0)

    def residuals(self, worlds):
        grips = [w.effects[0].params["grip"].value if w.effects else 1.0 for w in worlds]
        return [self.hidden - self.slipped(g) for g in grips]

    residuals_in_part = residuals


def test_sizes_of_a_threshold_are_tried_beyond_one_that_a_straight_line_calls_the_best():
    """A grip of 0.6 explains nine tenths, and so does every size along a line through it; one of 0.3 explains all."""
    evidence = Threshold()
    sizes = {p.placed.params["grip"].value: p for p in probed(evidence, World(), [("gripper_slip", "peg")], 30.0)}
    near = sizes[0.6]
    assert near.gain > 0.9 * near.promise > 0
    assert max(sizes, key=lambda g: sizes[g].gain) == 0.3


def test_a_screening_is_run_once_for_each_world_and_what_is_free_in_it(monkeypatch):
    """What is looked at before a search begins, and its first step, ask the same of the model as it was given."""
    asked = []
    monkeypatch.setattr("vispeg.contact.selection.search.probed", lambda *args: asked.append(list(args[-1])) or [])
    monkeypatch.setattr(ContactSearch, "needed_beside", lambda self, world: 15.0)
    search = object.__new__(ContactSearch)
    search.progress, search.evidence, search.n_fixed = Progress(), None, None
    moved = World().add(EffectInstance.of(*GRIP, x=1e-3))
    search.probed(World(), [OFFSET])
    for n_fixed, world in ((0, World()), (0, moved), (1, moved), (0, moved)):
        search.n_fixed = n_fixed
        search.probed(world, [OFFSET])
    assert asked == [[], [0], []]


def test_what_an_effect_gains_is_worked_out_once_and_never_below_none(monkeypatch):
    """A resumed diagnosis asks it again, of the same world, place and value."""
    asked = []

    def ask(self, tries, in_part):
        asked.append(self.world.label)
        return [SimpleNamespace(gain=-7.0)], [0.0]

    monkeypatch.setattr(Screen, "__init__", lambda self, evidence, world, free: setattr(self, "world", world))
    monkeypatch.setattr(Screen, "ask", ask)
    search = object.__new__(ContactSearch)
    search.progress, search.evidence, search.n_fixed = Progress(), None, 0
    offset, other = (EffectInstance.of(*OFFSET, x=size) for size in (1e-3, 2e-3))
    assert [search._gain_of(World(), e) for e in (offset, offset, other)] == [0.0, 0.0, 0.0]
    assert asked == ["nominal", "nominal"]
