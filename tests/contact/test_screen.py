"""What a size of an effect gains beside others: as much as if their parameters were fitted anew to it."""

from __future__ import annotations

import numpy as np
import pytest
from straight import Straight, search

from vispeg.contact.selection.profile import probed
from vispeg.contact.selection.screen import Screen
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.seeds import stream
from vispeg.worlds.world import World

OFFSET, GRIP = ("hole_offset", "fixture"), ("grip_pose", "peg")


HOLE = 1e5 * stream(1, "straight").standard_normal((60, 2))
GRASP = HOLE[:, 0] + 3e4 * stream(2, "straight").standard_normal(60)
HIDDEN = 2e-3 * GRASP + stream(3, "straight").standard_normal(60)


def two_alike() -> Straight:
    """A residual that is linear in a hole's x and y and in a grip's x, which acts nearly as the hole's x does."""
    slopes = {("hole_offset", "x"): HOLE[:, 0], ("hole_offset", "y"): HOLE[:, 1], ("grip_pose", "x"): GRASP}
    evidence = Straight(HIDDEN, slopes)
    kinds = (effect(name) for name in ("hole_offset", "grip_pose"))
    evidence.absent = {(k.name, p) for k in kinds for p in k.params if (k.name, p) not in slopes}
    return evidence


def test_beside_an_effect_another_gains_what_both_fitted_together_do():
    """The hole's offset alone stands for the grip's; beside it, as it is, no size of the grip's x gains anything."""
    evidence = two_alike()
    alone, *_ = np.linalg.lstsq(HOLE, HIDDEN, rcond=None)
    world = World().add(EffectInstance.of(*OFFSET, x=alone[0], y=alone[1]))
    before = float(np.sum(evidence.residuals([world])[0] ** 2))
    as_it_is = {
        p.placed.params["x"].value: p.gain for p in probed(Screen(evidence, world, ()), [GRIP], 30.0) if p.name == "x"
    }
    anew = {p.placed.params["x"].value: p for p in probed(Screen(evidence, world, [0]), [GRIP], 30.0) if p.name == "x"}
    assert max(as_it_is.values()) < 0.1 * before
    for size, probe in anew.items():
        rest = HIDDEN - GRASP * size
        fitted, *_ = np.linalg.lstsq(HOLE, rest, rcond=None)
        after = float(np.sum((rest - HOLE @ fitted) ** 2))
        assert probe.gain == pytest.approx(before - after, rel=1e-6)
    assert max(p.gain for p in anew.values()) > 0.5 * before


class Threshold(Straight):
    """A grip that slips under each of 60 forces up to 110 N beyond 120 N times its scale: the greatest count most."""

    def __init__(self):
        self.force = np.linspace(0.0, 110.0, 60)
        self.size = np.where(self.force > 72.0, 30.0, 8.0)
        super().__init__(self.slipped(0.3), {})

    def slipped(self, grip):
        return np.where(self.force > 120.0 * grip, self.size, 0.0)

    def residual(self, world):
        return self.hidden - self.slipped(world.effects[0].params["grip"].value if world.effects else 1.0)


def test_sizes_of_a_threshold_are_tried_beyond_one_that_a_straight_line_calls_the_best():
    """A grip of 0.6 explains nine tenths, and so does every size along a line through it; one of 0.3 explains all."""
    evidence = Threshold()
    sizes = {
        p.placed.params["grip"].value: p for p in probed(Screen(evidence, World(), ()), [("gripper_slip", "peg")], 30.0)
    }
    near = sizes[0.6]
    assert near.gain > 0.9 * near.promise > 0
    assert max(sizes, key=lambda g: sizes[g].gain) == 0.3


def test_a_screening_is_run_once_for_each_world_and_what_is_free_in_it():
    """What is looked at before a search begins, and its first step, ask the same of the model as it was given."""
    evidence = two_alike()
    searching = search(evidence)
    moved = World().add(EffectInstance.of(*GRIP, x=1e-3))
    answers, fresh = [searching.probed(World(), [OFFSET])], []
    for n_fixed, world in ((0, World()), (0, moved), (1, moved), (0, moved)):
        searching.n_fixed, before = n_fixed, evidence.asked
        answers.append(searching.probed(world, [OFFSET]))
        fresh.append(evidence.asked > before)
    assert fresh == [False, True, True, False]
    assert answers[0] == answers[1] and answers[2] == answers[4] != answers[3]


def test_a_size_is_simulated_once_for_what_it_gains_and_for_what_would_show():
    """The first screening has most of the sizes that minimum detectable sizes ask for."""

    class Counted(Straight):
        worlds: list[str] = []

        def residual(self, world):
            self.worlds.append(world.label)
            return super().residual(world)

    evidence = Counted(HIDDEN, {("hole_offset", "x"): HOLE[:, 0]})
    searching = search(evidence)
    tries = [("x", EffectInstance.of(*OFFSET, x=size)) for size in (1e-3, 3e-3)]
    first = searching.screen(World()).ask(tries)
    count = len(evidence.worlds)
    assert searching.screen(World()).ask(tries[::-1]) == first[::-1]
    assert len(evidence.worlds) == count


def test_what_an_effect_gains_is_worked_out_once_and_never_below_none():
    """A resumed diagnosis asks it again, of the same world, place and value."""
    evidence, fresh, gains = two_alike(), [], []
    searching = search(evidence)
    searching.n_fixed = 0
    worse, other, better = (EffectInstance.of(*OFFSET, x=size) for size in (-1e-3, -2e-3, 1e-3))
    for e in (worse, worse, other, better):
        before = evidence.asked
        gains.append(searching._gain_of(World(), e))
        fresh.append(evidence.asked > before)
    assert fresh == [True, False, True, True]
    drop = float(HIDDEN @ HIDDEN - np.sum((HIDDEN - 1e-3 * HOLE[:, 0]) ** 2))
    assert gains == [0.0, 0.0, 0.0, pytest.approx(drop)] and drop > 0
