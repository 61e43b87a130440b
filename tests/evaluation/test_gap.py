"""The gap, its attribution, comparisons and categories: known answers, identities, and what must not change."""

import json
import math

import numpy as np
import pytest
from scipy.stats import fisher_exact

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.evaluation.categories import part
from vispeg.evaluation.gap import gap
from vispeg.evaluation.modalities import compare
from vispeg.evaluation.records import Episode
from vispeg.evaluation.statistics.attribution import attribute, joint_of
from vispeg.evaluation.statistics.decide import CANNOT_TELL, decide, gap_words
from vispeg.evaluation.statistics.intervals import Estimate
from vispeg.evaluation.table import Cell, Table

WORLDS = {"S": 0.0, "V": -1.0, "N": -0.2, "P": -1.5, "VNP": -3.0}
POLICIES = {("depth", "depth"): 3.5, ("rgb", "rgb"): 2.5, ("blind", "proprio"): -1.0}


def exact(policy, world, wins, seeds=100, train_seed=0, modality="depth", category="jam"):
    return [
        Episode(policy, modality, train_seed, world, f"h{world}", s, s < wins, "success" if s < wins else category)
        for s in range(seeds)
    ]


def test_the_parts_add_up_to_the_total_and_counted_wins_give_counted_gaps():
    table = Table(e for w, n in {"S": 95, "V": 85, "P": 75, "VP": 50}.items() for e in exact("a", w, n))
    split = attribute(table, "a", "S", ["V", "P"], "VP", stream(0, "x"))
    assert split.total.value == pytest.approx(0.45)
    assert {f: e.value for f, e in split.factors.items()} == pytest.approx({"V": 0.10, "P": 0.20})
    assert split.remainder.value == pytest.approx(0.15)
    assert split.share("V") == pytest.approx(0.1 / 0.45)
    boot = split.bootstrap["total"]
    assert boot.low == pytest.approx(split.total.low, abs=0.02) and boot.high == pytest.approx(
        split.total.high, abs=0.02
    )


def test_the_joint_world_is_the_one_named_by_its_factors():
    assert joint_of(["S", "V", "N", "P", "VNP"], "S") == ("VNP", ["V", "N", "P"])
    assert joint_of(["S", "V", "N", "VN"], "S") == ("VN", ["V", "N"])
    assert joint_of(["S", "V", "VN"], "S") == (None, []) == joint_of(["S", "dev"], "S")


def test_one_pass_gives_every_table_and_is_the_same_whatever_the_order_of_records(invented):
    episodes = invented(POLICIES, WORLDS, train_seeds=3)
    found = gap(episodes, worlds=list(WORLDS))
    again = gap([episodes[i] for i in stream(0, "order").permutation(len(episodes))], worlds=list(WORLDS))
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    for key in ("success", "gaps", "attribution", "comparisons", "categories"):
        assert _sorted(found[key]) == _sorted(again[key])
    assert len(found["success"]) == 15 and len(found["gaps"]) == 12 and len(found["comparisons"]) == 15
    lost = {(g["policy"], g["world"]): g["gap"]["value"] for g in found["gaps"]}
    assert lost["depth", "VNP"] > lost["depth", "P"] > lost["depth", "N"]
    assert {g["verdict"] for g in found["gaps"] if g["policy"] == "depth" and g["world"] == "VNP"} == {"different"}


def _sorted(rows):
    rows = [{k: dict(sorted(v.items())) if isinstance(v, dict) else v for k, v in r.items()} for r in rows]
    for row in rows:  # bootstrap draws belong to positions, and positions to the order
        row.pop("bootstrap", None)
        if row.get("second") in ("depth", "rgb", "blind") and row["first"] > row["second"]:
            row["first"], row["second"] = row["second"], row["first"]
            low, high = row["difference"]["low"], row["difference"]["high"]
            row["difference"] |= {"value": -row["difference"]["value"], "low": -high, "high": -low}
    return sorted(json.dumps(_round(r), sort_keys=True) for r in rows)


def _round(x):
    if isinstance(x, dict):
        return {k: _round(v) for k, v in x.items()}
    return round(x, 9) + 0.0 if isinstance(x, float) else x


def test_the_rule_tells_different_equal_and_cannot_tell():
    assert decide(Estimate(0.1, 0.04, 0.16, 100)) == "different"
    assert decide(Estimate(0.1, 0.04, 0.16, 100), p=0.2) == CANNOT_TELL
    assert decide(Estimate(0.0, -0.03, 0.04, 900)) == "equal"
    assert decide(Estimate(0.02, -0.05, 0.09, 100)) == CANNOT_TELL
    assert gap_words(Estimate(0.23, 0.18, 0.29, 100)) == "loses 23 points (18 to 29)"
    assert gap_words(Estimate(-0.1, -0.15, -0.06, 100)) == "gains 10 points (6 to 15)"
    assert gap_words(Estimate(0.02, -0.05, 0.09, 100)) == f"{CANNOT_TELL}: anything from 9 points lost to 5 gained"


def test_few_episodes_cannot_tell_and_many_can():
    few = Table(exact("a", "S", 10, 10) + exact("b", "S", 8, 10))
    many = Table(exact("a", "S", 500, 500) + exact("b", "S", 400, 500))
    same = Table(exact("a", "S", 490, 500) + exact("b", "S", 489, 500))
    (row,) = compare(few, "S", ["a", "b"])
    assert row.verdict == CANNOT_TELL and row.needed and row.needed > 100
    assert compare(many, "S", ["a", "b"])[0].verdict == "different"
    assert compare(same, "S", ["a", "b"])[0].verdict == "equal"


def test_unpaired_seeds_of_a_robot_are_compared_as_independent_samples():
    robot = [Episode("a", "depth", 0, "robot", "", 1000 + i, i < 48, "success" if i < 48 else "jam") for i in range(80)]
    found = gap(exact("a", "S", 56, 70) + robot)
    row = found["gaps"][0]
    assert not row["paired"] and (row["gap"]["low"], row["gap"]["high"]) == pytest.approx((0.0524, 0.3339), abs=5e-5)


def test_a_rate_says_what_its_episodes_can_tell_and_the_scripted_policy_lacks_no_training_seeds():
    few, many = gap(exact("a", "S", 4, 4) + exact("expert", "S", 4, 4)), gap(exact("a", "S", 1960, 2000))
    assert [(r["words"], r["needed"]) for r in few["success"]] == [("4 of 4: 51 to 100 %", 384)] * 2
    assert many["success"][0]["needed"] is None
    networks = gap([e for t in range(3) for e in exact("a", "S", 2 + t, 4, t)])
    assert networks["success"][0]["needed"] is None, "more episodes do not make three networks more"
    assert [n for n in few["notes"] if "training seeds" in n] == [n for n in few["notes"] if n.startswith("a ")] != []
    assert [(p["scripted"], p["train_seeds"]) for p in few["policies"]] == [(False, [0]), (True, [])]


def test_a_robot_that_takes_longer_and_presses_harder_is_told_so():
    from dataclasses import replace

    def trials(time, force, world, digest, n=20):
        rng = stream(0, world, str(force))
        head = ("a", "depth", 0, world, digest)
        each = [(s, float(rng.normal(time, 0.3)), float(rng.normal(force, 4))) for s in range(n)]
        return [Episode(*head, s, True, "success", time=t, peak_force=f) for s, t, f in each]

    sim = trials(2.0, 57, "S", "h")
    rows = gap(sim + trials(5.35, 117, "robot", ""))["measures"]
    assert [(r["measure"], r["verdict"], r["apart"]) for r in rows] == [
        ("time", "different", False),
        ("peak_force", "different", True),
    ]
    assert f"a in robot: {rows[1]['words']}" in gap(sim + trials(5.35, 117, "robot", ""))["notes"], (
        "the page shows notes"
    )
    assert "longer" in rows[0]["words"] and "more than half apart: look at the contact model" in rows[1]["words"]
    near = gap(sim + trials(2.0, 66, "robot", ""))["measures"]
    assert [(r["verdict"], r["apart"]) for r in near] == [(CANNOT_TELL, False), ("different", False)]
    assert gap(sim + trials(5.0, 117, "P", "other world"))["measures"] == [], "that is what the tables show"
    untold = [replace(e, time=math.nan, peak_force=math.nan) for e in trials(5.0, 117, "robot", "")]
    assert gap(sim + untold)["measures"] == []


def test_pairing_takes_only_shared_seeds():
    table = Table(exact("a", "S", 50) + exact("a", "T", 50)[:60])
    y = table.aligned("a", ["S", "T"])
    assert y["S"].shape == (1, 60) and np.array_equal(y["S"], y["T"])
    with pytest.raises(UserError, match="no episodes there.*choices: S, T"):
        table.aligned("a", ["S", "X"])
    with pytest.raises(UserError, match="same seeds"):
        Table(exact("a", "S", 1, 5)[:2] + exact("a", "T", 1, 5)[3:]).aligned("a", ["S", "T"])
    with pytest.raises(UserError, match="two modalities"):
        Table(exact("a", "S", 1) + exact("a", "T", 1, modality="rgb"))


def test_controls_are_rows_of_their_own_and_do_not_enter_the_gap(invented):
    episodes = invented({("d", "depth"): 3.0}, {"S": 0.0, "V": -1.0})
    shuffled = [Episode(**{**e.__dict__, "control": "shuffled", "success": False, "category": "jam"}) for e in episodes]
    plain, both = gap(episodes), gap(episodes + shuffled)
    assert both["gaps"] == plain["gaps"] and both["prediction"] == plain["prediction"]
    assert [r["success"]["value"] for r in both["success"] if r["control"]] == [0, 0]
    assert table_has(Table(episodes + shuffled))
    fixed = [Episode(**{**e.__dict__, "control": "hole_fixed", "world_hash": "fixed"}) for e in episodes]
    assert Table(fixed + episodes).hashes == {"S": "hash-S", "V": "hash-V"}


def test_a_result_without_a_blind_control_says_so():
    assert any("no blind control" in note for note in gap(exact("a", "S", 50))["notes"])
    both = gap(exact("a", "S", 50) + exact("b", "S", 5, modality="proprio"))
    assert not any("no blind control" in note for note in both["notes"])


def table_has(table):
    return table.controls == ["shuffled"] and table.has(Cell("d", "V", "shuffled"))


def test_failures_of_one_distribution_pass_and_of_another_are_found_where_they_part():
    rng = stream(0, "parting")
    names = np.array(["search", "jam", "slip"])
    p = [part(*(rng.choice(names, 60, p=[0.5, 0.3, 0.2]) for _ in "ab"), rng, 400).p for _ in range(200)]
    assert np.mean(np.array(p) < 0.05) < 0.1
    found = part(["search"] * 30 + ["jam"] * 10, ["search"] * 10 + ["jam"] * 30 + ["success"] * 50, rng)
    assert found.p < 0.001 and found.where in ("jam", "search") and found.second == {"search": 10, "jam": 30}
    one = part(["jam"] * 9, ["jam"] * 20, rng)
    assert one.p == 1.0 and one.residual == 0.0


def test_few_failures_are_compared_too_and_where_they_say_nothing_the_record_says_so():
    rng = stream(0, "few")
    first, second = ["jam"] * 3 + ["success"] * 37, ["search"] * 4 + ["slip"] * 5 + ["success"] * 31
    found = part(first, second, rng)
    assert found.p == pytest.approx(1 / math.comb(12, 3)) and found.where == "jam" and found.verdict == "different"
    tables = [[[3, 0], [0, 9]], [[3, 37], [0, 40]], [[0, 40], [5, 35]]]
    assert found.p == pytest.approx(fisher_exact(tables[0]).pvalue)  # the three jams against all others
    assert {k.category: k.p for k in found.kinds}["jam"] == pytest.approx(fisher_exact(tables[1]).pvalue)
    few = part(["jam"] * 2, ["jam", "slip", "slip"], rng)
    assert few.p > 0.05 and few.verdict == CANNOT_TELL and CANNOT_TELL in few.words and few.where

    sure = part(["success"] * 40, ["success"] * 11 + ["search"] * 8 + ["dropped"], rng)  # the usual case of a robot
    assert sure.p == 1.0 and sure.verdict == CANNOT_TELL
    assert [(k.category, k.verdict) for k in sure.kinds] == [("search", "more"), ("dropped", CANNOT_TELL)]
    assert sure.kinds[0].p == pytest.approx(fisher_exact([[0, 40], [8, 12]]).pvalue)
    assert "more search: 0 to 40 % of the episodes" in sure.words
    none = part(["success"] * 4, ["success"] * 4, rng)
    assert none.words == "no failure on either side" and none.kinds == ()
    assert None not in (*found.to_json().values(), *sure.to_json().values(), *none.to_json().values())


def test_listed_and_drawn_tables_agree(monkeypatch):
    rng = stream(0, "drawn")
    sides = ["a"] * 6 + ["b"] * 2 + ["c"] * 3, ["a"] * 3 + ["b"] * 8 + ["c"] * 4
    listed = part(*sides, rng).p
    monkeypatch.setattr("vispeg.evaluation.categories.MOST_TABLES", 0)
    assert part(*sides, rng, 40_000).p == pytest.approx(listed, abs=0.01)


def test_the_largest_residual_is_the_two_proportion_z():
    found = part(["a"] * 12 + ["b"] * 28 + ["c"] * 20, ["a"] * 30 + ["b"] * 12 + ["c"] * 18, stream(0, "z"))
    pooled = 42 / 120
    z = (30 / 60 - 12 / 60) / np.sqrt(pooled * (1 - pooled) * (2 / 60))
    assert found.where == "a" and found.residual == pytest.approx(z)


def test_prediction_over_checkpoints_counts_bad_ones():
    episodes = []
    for i in range(9):
        episodes += exact(f"step{i}", "S", 10 + 10 * i) + exact(f"step{i}", "T", 5 + 10 * i)
    row = gap(episodes)["prediction"][0]
    assert row["pearson"]["value"] == pytest.approx(1) and row["mean_difference"]["value"] == pytest.approx(0.05)
    assert row["mmrv"]["value"] == 0 and row["words"].startswith("r = 1.00")
    assert CANNOT_TELL in gap(episodes[:400])["prediction"][0]["words"]


def test_unknown_worlds_are_named():
    with pytest.raises(UserError, match="no episodes in this world.*'X'.*choices: S"):
        gap(exact("a", "S", 50), worlds=["S", "X"])
    with pytest.raises(UserError, match="no episodes in this world"):
        gap(exact("a", "T", 50))
