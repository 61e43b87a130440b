"""Hidden plants are what their number says, and comparisons over plants are Student's and Fisher's."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from identification import arm_of, identified_world
from over_plants import compared, markdown, mean_difference
from plants import BUNDLED, hidden_plant
from training import Budget, Variant, configuration
from transfer_table import success_table

from vispeg.core.effect import EffectInstance
from vispeg.core.params import Value
from vispeg.evaluation.records import Episode
from vispeg.task.world_file import load_world
from vispeg.worlds.distribution import Normal
from vispeg.worlds.model_file import model_text
from vispeg.worlds.world import World


def test_an_experiment_that_would_leave_out_all_of_its_plants_says_so(tmp_path):
    script = Path(__file__).parents[2] / "scripts" / "experiments" / "dynamics_transfer.py"
    options = ["--first", "5", "--plants", "5", "--runs", tmp_path / "runs", "--out", tmp_path / "out"]
    done = subprocess.run([sys.executable, script, *options], capture_output=True, text=True)
    said = "first: no plant is left; expected less than 5; got 5\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", said) and not any(tmp_path.iterdir())


def test_a_plant_is_drawn_by_its_number_alone_and_hides_something_in_arm_and_cell(tmp_path):
    assert hidden_plant(0, tmp_path) == BUNDLED
    hashes = {}
    for number in range(1, 6):
        path = hidden_plant(number, tmp_path)
        hashes[number] = load_world(path).hash
        assert load_world(hidden_plant(number, tmp_path / "again")).hash == hashes[number]
        arm = {e.effect for e in arm_of(path).effects}
        assert {"coulomb_friction", "viscous_friction", "payload"} <= arm and "hole_tilt" not in arm
    assert len(set(hashes.values())) == 5


def test_latency_is_recorded_only_where_the_plant_has_it(tmp_path):
    late = {"command_delay" in load_world(hidden_plant(n, tmp_path)).path.read_text() for n in range(1, 6)}
    assert late == {True, False}
    for number in range(1, 6):
        path = hidden_plant(number, tmp_path)
        found = [e.params["delay"].value for e in arm_of(path).effects if e.effect == "command_delay"]
        assert found == ([0.006] if "command_delay" in path.read_text() else [])


def test_what_was_identified_becomes_a_world_with_its_values_as_centres(tmp_path):
    friction = EffectInstance("coulomb_friction", "joint4", {"torque": Value(1.3, 1.1, 1.5)})
    (tmp_path / "model.yaml").write_text(model_text(World("iiwa14", "meg50+peg16").add(friction)))
    file = load_world(identified_world(tmp_path / "model.yaml", "randomized", tmp_path / "made.yaml"))
    drawn = [r for r in file.world.ranges if (r.effect, r.where) == ("coulomb_friction", "joint4")]
    (torque,) = (r.params["torque"] for r in drawn)
    assert isinstance(torque, Normal)
    assert torque.mean == pytest.approx(1.3) and torque.sd == pytest.approx(0.4 / 3.92, rel=1e-3)
    assert len(file.world.ranges) > 5  # those of `randomized` stay


def test_ranges_open_as_the_variant_says():
    assert configuration(Variant("a", "randomized"), 1, Budget(200, 100, 5)).ranges == "full"
    assert configuration(Variant("a", "randomized", ranges="schedule"), 1, Budget(200, 100, 5)).ranges == "schedule"


def table(world, first, second):
    head = ("state", 1, world, "abc")
    played = [
        Episode(name, *head, i, i < count, "success" if i < count else "jam", peak_force=30.0)
        for name, count in (("a", first), ("b", second))
        for i in range(20)
    ]
    return success_table(played, world)


def test_plants_are_the_sample():
    tables = [table("p", 20, 10), table("q", 18, 18), table("r", 16, 12)]
    found = compared(tables, "a", "b")
    assert [row["difference"] for row in found["plants"]] == pytest.approx([0.5, 0.0, 0.2])
    d = np.array([0.5, 0.0, 0.2])
    half = 4.302653 * d.std(ddof=1) / np.sqrt(3)  # Student's t, two degrees of freedom
    assert found["over_plants"]["high"] - found["over_plants"]["value"] == pytest.approx(half, rel=1e-5)
    assert found["over_plants"]["p"] == pytest.approx(4 / 8)  # of eight flips, those of the zero change nothing
    assert found["hard"]["n"] == 2 and found["hard"]["value"] == pytest.approx(0.35)
    assert found["better"] == 1  # 10 of 20 pairs, all one way
    back = compared(tables, "b", "a")
    assert back["over_plants"]["value"] == pytest.approx(-found["over_plants"]["value"]) and back["better"] == 0
    assert "| p | 100.0 % | 50.0 % | +50.0 |" in markdown(found)


def test_one_plant_has_no_interval():
    assert mean_difference([0.2]) == {"value": 0.2, "low": None, "high": None, "n": 1, "p": None}
    assert mean_difference([])["value"] is None and mean_difference([0.1] * 6)["p"] == pytest.approx(2 / 64)
