"""A dozen hidden effects from the benchmark's development set: the diagnosis sees only the recordings.

The plant is not the model's code (scripts/bench/hidden_effects): another step size, other equations, sensor noise.
"""

from __future__ import annotations

import pytest
from cases import DEV, choose
from make import folders, make

from vispeg.diagnosis.run import diagnose
from vispeg.recordings.load import load
from vispeg.worlds.world import World

NAMED = ["viscous_friction/joint6/small"]
AS_WELL = [
    "cogging/joint1/small",
    "torque_limit/joint4/small",
    "coulomb_friction/joint4/small",
    "viscous_friction/joint1/small",
    "hysteresis/joint1/small",
    "joint_elasticity/joint2/small",
    "backlash/joint1/small",
    "cable_spring/joint4/small",
]


def verdict(name: str, folder) -> dict:
    (case,) = choose((name,), DEV)
    make(folder, [case])
    first, second, last = (load(f) for f in folders(folder, case))
    return diagnose(World(), [first, second], [last], nthread=1, plan_next=False).record


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", [*NAMED, *(pytest.param(name, marks=pytest.mark.slow) for name in AS_WELL)])
def test_the_hidden_effect_is_named_and_the_error_falls(name, tmp_path):
    kind, where, _ = name.split("/")
    record = verdict(name, tmp_path)
    assert record["verdict"] in ("identified", "ambiguous"), record["reason"]
    assert [(e["effect"], e["where"]) for e in record["effects"]] == [(kind, where)]
    errors = [rung["heldout_error"] for rung in record["ladder"]]
    assert errors[-1] < errors[0] / 8


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", ["none/07", pytest.param("none/02", marks=pytest.mark.slow)])
def test_nothing_hidden_nothing_named(name, tmp_path):
    record = verdict(name, tmp_path)
    assert record["verdict"] == "adequate" and record["effects"] == []


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_disturbance_outside_the_library_gets_no_name(tmp_path):
    record = verdict("vibration/joint2/large", tmp_path)
    assert record["verdict"] == "unexplained" and record["effects"] == []
    assert record["unexplained"]["text"]
