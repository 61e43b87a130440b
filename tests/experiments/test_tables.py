"""The experiments' tables and curves on hand-made results whose numbers are known."""

import numpy as np
import pytest
from curves import Curve, read_curve, together
from transfer_table import markdown, success_table

from vispeg.core.errors import UserError
from vispeg.evaluation.records import Episode


def episodes(policy, train_seed, outcomes, world="plant"):
    return [
        Episode(policy, "state", train_seed, world, "abc", 100 + i, bool(y), "success" if y else "jam", peak_force=30.0)
        for i, y in enumerate(outcomes)
    ]


def curve(steps, success):
    steps = np.array(steps)
    return Curve(steps, steps / 50.0, np.array(success, float), 50.0 * np.array(success), np.full(len(steps), 20.0))


def test_transfer_table_counts_by_seed_and_pools():
    naive, better = [1] * 10 + [0] * 10, [1] * 19 + [0]
    given = [*episodes("a", 1, naive), *episodes("a", 2, naive), *episodes("b", 1, better), *episodes("b", 2, better)]
    table = success_table([*given, *episodes("a", 1, naive, "elsewhere")], "plant")
    a, b = table["rows"]
    assert [(t, e["value"], e["n"]) for t, e in a["by_seed"].items()] == [(1, 0.5, 20), (2, 0.5, 20)]
    # Wilson: centre 1/2, half width z sqrt(1/4/n + z^2/4/n^2) / (1 + z^2/n)
    z, n = 1.959964, 40
    half = z * np.sqrt(0.25 / n + z**2 / 4 / n**2) / (1 + z**2 / n)
    assert a["pooled"]["low"] == pytest.approx(0.5 - half, abs=1e-5) and a["pooled"]["n"] == n
    assert a["categories"] == {"success": 20, "jam": 20} and b["pooled"]["value"] == 0.95
    (c,) = table["comparisons"]
    assert c["difference"]["value"] == pytest.approx(-0.45)
    assert c["p"] is None and c["verdict"] != "different", "two training seeds say nothing of a recipe"
    (one,) = success_table([*episodes("a", 1, naive), *episodes("b", 1, better)], "plant")["comparisons"]
    # of the twenty pairs 1 to 10 are won by both, 11 to 19 by b alone
    assert one["p"] == pytest.approx(2 * 0.5**9)


def test_holm_multiplies_the_smallest_of_three_by_three():
    a, b, c = [0] * 20, [1] * 10 + [0] * 10, [1] * 20
    table = success_table([*episodes("a", 1, a), *episodes("b", 1, b), *episodes("c", 1, c)], "plant")
    found = {(r["first"], r["second"]): (r["p"], r["p_holm"]) for r in table["comparisons"]}
    assert found["a", "c"][1] == pytest.approx(3 * found["a", "c"][0])
    assert found["a", "b"][1] == pytest.approx(2 * found["a", "b"][0])


def test_markdown_has_a_row_a_policy_and_marks_missing_seeds():
    given = [*episodes("a", 1, [1, 0]), *episodes("a", 2, [1, 1]), *episodes("b", 1, [0, 0])]
    lines = markdown(success_table(given, "plant")).splitlines()
    assert lines[2].startswith("| a | 50.0 % (") and "| 100.0 % (" in lines[2] and "jam 1" in lines[2]
    assert lines[3].split(" | ")[2] == "-"
    assert len({line.count("|") for line in lines[:4]}) == 1


def test_curves_meet_at_shared_steps_only():
    found = together([curve([10, 20, 30], [0.0, 0.5, 1.0]), curve([10, 30, 40], [0.2, 0.6, 0.9])])
    assert found["steps"] == [10, 30] and found["seeds"] == 2
    assert found["mean"] == pytest.approx([0.1, 0.8])
    assert found["low"] == pytest.approx([0.0, 0.6]) and found["high"] == pytest.approx([0.2, 1.0])
    assert found["seconds"] == pytest.approx([0.2, 0.6])
    assert found["return"]["mean"] == pytest.approx([5, 40]) and found["return"]["high"] == pytest.approx([10, 50])
    with pytest.raises(UserError, match="no step in common"):
        together([curve([10], [0.0]), curve([20], [0.0])])


def test_a_curve_says_when_it_first_reached_a_rate(tmp_path):
    path = tmp_path / "progress.csv"
    path.write_text("steps,seconds,success,reward,peak_force\n10,1.5,0.1,-8,20\n20,3,0.8,30,30\n30,4,0.7,25,25\n")
    found = read_curve(path)
    assert found.reaches(0.8) == 20 and found.reaches(0.9) is None
    assert found.seconds.tolist() == [1.5, 3, 4] and found.returns.tolist() == [-8, 30, 25]
    path.write_text("steps,seconds,success,reward,peak_force\n")
    with pytest.raises(UserError, match="no evaluation yet"):
        read_curve(path)
