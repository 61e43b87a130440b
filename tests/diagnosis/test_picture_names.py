"""What a picture's effect has to do to be a name: something that no others do, alike in two recordings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.diagnosis.pictures.agreement import Agreement, agreement
from vispeg.diagnosis.pictures.borders import BorderSearch
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.worlds.world import World

WRIST = "wrist_wide"


@dataclass(frozen=True)
class Tried:
    """A trial that passed, or did not."""

    fit: Any
    score: Any
    rejected: str = ""


def offset(x: float) -> World:
    return World().add(EffectInstance.of("camera_offset", WRIST, x=x))


class Line(BorderEvidence):
    """Four border points that a camera's offset in x moves by 100 px/m each; the last one is not trusted."""

    def __init__(self) -> None:
        self.items = [SimpleNamespace(valid=np.array([[True], [True], [True], [False]]))]  # type: ignore[list-item]

    def misplaced(self, world: World) -> list[np.ndarray]:
        x = sum(e.params["x"].value for e in world.effects)
        return [np.array([100.0, -100.0, 100.0, 1e4]) * x]


def test_what_others_do_as_well_or_one_recording_says_alone_is_no_name():
    assert Agreement(1.0, 0.1).doubt(0.2) == ""
    assert "others do all but" in Agreement(0.19, 0.0).doubt(0.2)
    assert "two recordings differ" in Agreement(0.4, 0.21).doubt(0.2)


def test_agreement_compares_the_differences_that_an_effect_makes_in_two_recordings():
    again = {"with": offset(0.003), "without": World()}
    search = SimpleNamespace(judged=Line(), fits=lambda worlds, given, judged: [SimpleNamespace(world=again["with"])])
    said = agreement(search, offset(0.004), World(), 0)  # type: ignore[arg-type]
    assert said.size == pytest.approx(0.4) and said.apart == pytest.approx(0.1)


def test_the_first_name_that_is_not_doubted_comes_first_and_says_why_the_others_are():
    search = object.__new__(BorderSearch)
    search.doubt = lambda placed, added, without, given: "others do it" if added == "a" else ""  # type: ignore
    trials = [Tried(SimpleNamespace(world=w), SimpleNamespace(placed=None), why) for w, why in ("a ", "b ", "cx")]
    trials = [replace(t, fit=SimpleNamespace(world=t.fit.world.strip()), rejected=t.rejected.strip()) for t in trials]
    state: Any = SimpleNamespace(world=World())
    order = search.questioned(state, trials, 0)  # type: ignore[arg-type]
    assert [t.fit.world for t in order] == ["b", "c", "a"]
    assert [t.rejected for t in order] == ["", "x", "others do it"]


def test_what_only_motion_makes_needs_fewer_pixels_than_what_a_look_may_make():
    search = object.__new__(BorderSearch)
    search.least = RULES.shift_px
    late, off = (EffectInstance.of(name, WRIST) for name in ("camera_delay", "camera_offset"))
    assert search.least_of(late) == RULES.moving_px < search.least_of(off) == RULES.shift_px
