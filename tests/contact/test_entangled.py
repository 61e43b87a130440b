"""What a recording determines in combination alone is ambiguous, and the motion that tells it apart is asked for."""

from types import SimpleNamespace

import numpy as np
import pytest

from vispeg.contact.next_motion import separating
from vispeg.contact.selection.entangled import beside, entangled, judged, tilted
from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.conclusion.verdict import Verdict
from vispeg.worlds.world import World

TOOL = EffectInstance.of("tool_mass", "gripper", mass=2.0)
GAIN = EffectInstance.of("wrench_gain", "flange", gain=0.3)
FRICTION = EffectInstance.of("contact_friction", "peg", scale=1.7)


def fitted(a, b, correlation):
    axes = (SimpleNamespace(index=0), SimpleNamespace(index=1))
    matrix = np.array([[1.0, correlation], [correlation, 1.0]])
    return SimpleNamespace(world=World().add(a, b), space=SimpleNamespace(axes=axes), correlation=matrix)


def test_a_heavier_tool_and_a_weaker_sensor_are_one_combination():
    pairs = entangled(fitted(TOOL, GAIN, -0.93), 0, True)
    assert pairs == [(TOOL, GAIN)]
    verdict = judged(Verdict("identified", "both"), pairs)
    assert verdict.verdict == "ambiguous" and TOOL.label in verdict.reason and GAIN.label in verdict.reason
    record = [{"effect": e.effect, "where": e.where, "indistinguishable_from": []} for e in (TOOL, GAIN)]
    found = beside(record, pairs)
    assert [o["effect"] for e in found for o in e["indistinguishable_from"]] == ["wrench_gain", "tool_mass"]
    assert separating(World().add(TOOL, GAIN), [], [], pairs)["motion"] == "free"


@pytest.mark.parametrize(
    ("a", "b", "correlation", "n_fixed"), [(TOOL, GAIN, 0.5, 0), (FRICTION, GAIN, 0.99, 0), (TOOL, GAIN, 0.99, 2)]
)
def test_others_are_not(a, b, correlation, n_fixed):
    """Hardly correlated, no effects that look alike, or what the user gave."""
    assert entangled(fitted(a, b, correlation), n_fixed, True) == []
    assert judged(Verdict("identified", "both"), []).verdict == "identified"


def test_a_tool_that_hangs_straight_does_not_tell_its_weight_from_the_sensors_gain():
    """Whatever the estimates say: one attitude, one weight."""
    hanging, leaning = np.zeros((50, 6)), np.zeros((50, 6))
    leaning[:, 3], leaning[:, 4] = np.linspace(0, 0.3, 50), np.linspace(0, 0.3, 50)
    items = [SimpleNamespace(path=SimpleNamespace(place=place)) for place in (hanging, leaning)]
    assert not tilted(items[:1]) and tilted(items)
    weak = fitted(TOOL, GAIN, 0.1)
    assert entangled(weak, 0, False) == [(TOOL, GAIN)] and entangled(weak, 0, True) == []
    assert entangled(fitted(FRICTION, GAIN, 0.1), 0, False) == []
