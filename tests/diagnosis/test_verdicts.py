"""Every verdict, end to end, on a pendulum: short recordings of a plant, and the whole diagnosis of them."""

from dataclasses import replace

import numpy as np
import pytest
from loops import hinge, pendulum, swings

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.run import diagnose
from vispeg.worlds.world import World

SECONDS, RATE = 3.0, 200.0


def diagnosed(hidden: World, *, rattle: float = 0.0):
    """The diagnosis of three swings of a pendulum; its mount rattles by `rattle`, rad, at 7 Hz."""
    t = np.arange(round(SECONDS * RATE)) / RATE
    shaken = [rattle * np.sin(2 * np.pi * 7.0 * t + i)[:, None] for i in range(3)]
    out = [replace(rec, q=rec.q + q) for rec, q in zip(swings(hidden, 3, SECONDS), shaken, strict=True)]
    return diagnose(World(pendulum().source), out[:2], out[2:], nthread=1, plan_next=False)


def test_the_right_model_is_adequate():
    record = diagnosed(World()).record
    assert record["verdict"] == "adequate" and record["effects"] == []
    assert record["ladder"][-1]["heldout_error"] == pytest.approx(record["noise_floor"]["value"], rel=0.1)


def test_a_hidden_effect_is_identified_with_its_size_and_the_error_falls_to_the_floor():
    (made,) = (hidden := hinge("viscous_friction", damping=0.5)).effects
    found = diagnosed(hidden)
    assert found.record["verdict"] == "identified"
    assert [e.label for e in found.world.effects] == [made.label]
    value = found.world.effects[0].params["damping"]
    assert value.low < 0.5 < value.high and value.value == pytest.approx(0.5, rel=0.01)
    errors = [rung["heldout_error"] for rung in found.record["ladder"]]
    floor = found.record["noise_floor"]["value"]
    assert errors[0] > 100 * errors[-1] and errors[-1] == pytest.approx(floor, rel=0.1)
    (named,) = found.record["effects"]
    assert named["without"] == pytest.approx(errors[0] / floor, rel=1e-9), "without it, it is the user's model"
    fall = (errors[0] ** 2 - errors[-1] ** 2) / (errors[0] ** 2 - floor**2)
    assert named["explains"] == pytest.approx(fall, abs=1e-4)


def test_delays_that_the_encoder_cannot_tell_apart_are_ambiguous():
    """In one joint a late command and a late reading delay the loop alike."""
    record = diagnosed(World().add(EffectInstance.of("sensor_delay", "all", delay=0.004))).record
    assert record["verdict"] == "ambiguous"
    (named,) = record["effects"]
    alike = {named["effect"], *(other["effect"] for other in named["indistinguishable_from"])}
    assert {"sensor_delay", "command_delay"} <= alike


def test_what_no_effect_explains_gets_no_name_and_its_frequency_is_said():
    record = diagnosed(World(), rattle=2e-3).record
    assert record["verdict"] == "unexplained" and record["effects"] == []
    assert "frequency (6.9 Hz)" in record["unexplained"]["text"]
