"""The gap, its attribution, comparisons and categories: known answers, identities, and what must not change."""

import json
import math

import numpy as np
import pytest
from scipy.stats import fisher_exact

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.evaluation.categories import part
from vispeg.evaluation.gap import gap, joint_of
from vispeg.evaluation.records import Episode
from vispeg.evaluation.statistics import CANNOT_TELL, decide
from vispeg.evaluation.table import Cell, Table

WORLDS = {"S": 0.0, "V": -1.0, "N": -0.2, "P": -1.5, "VNP": -3.0}
POLICIES = {("depth", "depth"): 3.5, ("rgb", "rgb"): 2.5, ("blind", "proprio"): -1.0}


def exact(policy, world, wins, seeds=100, train_seed=0, modality="depth", category="jam"):
    return [
        Episode(policy, modality, train_seed, world, f"h{world}", s, s < wins, "success" if s < wins else category)
        for s in range(seeds)
    ]


def ends(*categories):
    """Of one network, numbered by side, so that nothing pairs."""
    return [{0: {(side, i): end for i, end in enumerate(each)}} for side, each in enumerate(categories)]


def decided(parting):
    """What a page with this alone says of it."""
    return parting.decided(decide(parting.tests))


def test_the_parts_add_up_to_the_total_and_counted_wins_give_counted_gaps():
    found = gap(e for w, n in {"S": 95, "V": 85, "P": 75, "VP": 50}.items() for e in exact("a", w, n))
    (row,) = found["attribution"]
    value = {name: e["value"] for name, e in row["parts"].items()}
    assert value == pytest.approx({"total": 0.45, "V": 0.10, "P": 0.20, "remainder": 0.15})
    part = row["share"]["V"]
    assert part["value"] == pytest.approx(0.1 / 0.45) and 0.05 < part["low"] < 0.2 < part["high"] < 0.4
    assert set(row["verdict"].values()) == {"different"}


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
    one = gap(invented(POLICIES, WORLDS), worlds=list(WORLDS))
    assert {g["verdict"] for g in one["gaps"] if g["policy"] == "depth" and g["world"] == "VNP"} == {"different"}


def _sorted(rows):
    rows = [{k: dict(sorted(v.items())) if isinstance(v, dict) else v for k, v in r.items()} for r in rows]
    for row in rows:
        if row.get("second") in ("depth", "rgb", "blind") and row["first"] > row["second"]:
            row["first"], row["second"] = row["second"], row["first"]
            low, high = row["difference"]["low"], row["difference"]["high"]
            row["difference"] |= {"value": -row["difference"]["value"], "low": -high, "high": -low}
    return sorted(json.dumps(_round(r), sort_keys=True) for r in rows)


def _round(x):
    if isinstance(x, dict):
        return {k: _round(v) for k, v in x.items()}
    return round(x, 9) + 0.0 if isinstance(x, float) else x


def test_few_episodes_cannot_tell_and_many_can():
    def verdict(*episodes):
        (row,) = gap([e for some in episodes for e in some])["comparisons"]
        return row["verdict"], row["needed"]

    few = verdict(exact("a", "S", 10, 10), exact("b", "S", 8, 10))
    assert few[0] == CANNOT_TELL and few[1] > 100
    assert verdict(exact("a", "S", 500, 500), exact("b", "S", 400, 500))[0] == "different"
    assert verdict(exact("a", "S", 490, 500), exact("b", "S", 489, 500))[0] == "equal"


def test_of_pages_on_which_nothing_differs_few_call_anything():
    """Four policies in four worlds, success, failures, pairs and gaps; the rule of before called 43 to 48 %."""
    assert called(0, 1, 16) + called(1, 3, 8) <= 3
    assert called(2, 2, 2) == 0


@pytest.mark.slow
def test_of_many_pages_on_which_nothing_differs_at_most_five_per_cent_call_anything():
    for k, most in ((1, 0.07), (3, 0.07), (2, 0.0)):
        assert called(k, k, 300) / 300 <= most, k


def called(seed, train_seeds, pages):
    """Pages that call something, of policies that are all alike; each network is a little better or worse."""
    rng, count = stream(seed, "nothing"), 0
    for _ in range(pages):
        episodes = []
        hard = rng.standard_normal(60)
        for policy in "abcd":
            for t in range(train_seeds):
                luck = 0.7 * rng.standard_normal() * (train_seeds > 1)
                for world in ("S", "V", "P", "VP"):
                    odds = 1.0 + luck + hard + 0.3 * rng.standard_normal() * (train_seeds > 1)
                    for s, ok in enumerate(rng.uniform(size=60) < 1 / (1 + np.exp(-odds))):
                        end = "success" if ok else str(rng.choice(["jam", "search"]))
                        episodes.append(Episode(policy, "depth", t, world, world, s, bool(ok), end))
        found = gap(episodes, worlds=["S", "V", "P", "VP"])
        said = [r["verdict"] for r in (*found["gaps"], *found["comparisons"], *found["categories"])]
        said += [v for r in found["attribution"] for v in r["verdict"].values()]
        said += [k["verdict"] for r in found["categories"] for k in r["kinds"]]
        count += bool({"different", "more", "fewer"} & set(said))
    return count


def test_four_losses_of_a_hundred_in_three_worlds_are_none():
    found = gap(e for w, n in {"S": 100, "V": 96, "N": 96, "P": 96}.items() for e in exact("a", w, n))
    assert {g["verdict"] for g in found["gaps"]} == {CANNOT_TELL}
    assert not any("loses" in g["words"] for g in found["gaps"]) and {g["p"] for g in found["gaps"]} == {0.125}


def trials(policy, wins, n, train_seed=0, start=1):
    """A robot's, numbered on from `start`."""
    ends = [(start + i, i < wins) for i in range(n)]
    head = (policy, "depth", train_seed, "robot", "")
    return [Episode(*head, number, ok, "success" if ok else "jam") for number, ok in ends]


def test_a_robots_trials_are_compared_with_the_network_that_was_tried():
    """One network at 95 % in simulation and on the robot, its siblings at 10 %: the policy gains nothing there."""
    simulated = [e for t, n in enumerate((95, 10, 10)) for e in exact("a", "S", n, train_seed=t)]
    found = gap([*simulated, *trials("a", 19, 20)])
    (row,) = found["gaps"]
    assert (row["gap"]["value"], row["paired"], row["train_seeds"]) == (pytest.approx(0.0), False, [0])
    assert row["verdict"] == CANNOT_TELL and any("training seed 0" in n for n in found["notes"])
    assert found["categories"][0]["n"] == [100, 20]
    none = gap([*simulated, *trials("a", 19, 20, train_seed=7)])
    assert not none["gaps"] and any(
        "none of training seeds 7, played in robot, was played in S" in n for n in none["notes"]
    )


def test_trials_numbered_on_over_networks_all_count():
    simulated = [e for t in range(3) for e in exact("a", "S", 95, train_seed=t)]
    for starts in ((1, 21, 41), (1, 20, 39)):
        tried = [e for t, start in enumerate(starts) for e in trials("a", 10 + t, 20, t, start)]
        found = gap([*simulated, *tried])
        rate = next(r["success"] for r in found["success"] if r["world"] == "robot")
        assert rate["n"] == 60 and rate["value"] == pytest.approx(33 / 60)
        assert found["gaps"][0]["train_seeds"] == [0, 1, 2] and found["gaps"][0]["verdict"] == "different"


def test_policies_and_worlds_that_share_no_seeds_are_compared_as_samples_and_that_is_said():
    later = [Episode(**{**e.__dict__, "seed": e.seed + 99}) for e in exact("b", "S", 40) + exact("a", "V", 90)]
    found = gap(exact("a", "S", 95) + exact("b", "V", 30) + later)
    by = {(c["world"], c["first"], c["second"]): c for c in found["comparisons"]}
    assert not by["S", "a", "b"]["paired"] and by["S", "a", "b"]["difference"]["n"] == 100, "one seed is of both"
    assert by["S", "a", "b"]["verdict"] == "different"
    lines = [n for n in found["notes"] if "did not play the same seeds" in n]
    assert len(lines) == 4, lines


def test_a_policy_is_at_home_where_it_was_trained():
    """Naive and identified policies are compared in both worlds, and each is marked in its own."""
    both = [e for p in ("naive", "ident") for w in ("S", "mine") for e in exact(p, w, 90 if p == "naive" else 80)]
    found = gap(both, homes={"naive": ["hS"], "ident": ["hmine"]})
    assert {p["name"]: p["home"] for p in found["policies"]} == {"naive": ["S"], "ident": ["mine"]}
    assert {g["policy"]: g["home"] for g in found["gaps"]} == {"naive": False, "ident": True}
    assert len(found["comparisons"]) == 2
    assert [p["home"] for p in gap(both)["policies"]] == [None, None], "records alone do not tell"


def test_unpaired_seeds_of_a_robot_are_compared_as_independent_samples():
    robot = [Episode("a", "depth", 0, "robot", "", 1000 + i, i < 48, "success" if i < 48 else "jam") for i in range(80)]
    found = gap(exact("a", "S", 56, 70) + robot)
    row = found["gaps"][0]
    assert not row["paired"] and row["gap"]["value"] == pytest.approx(0.2)
    assert row["p"] == pytest.approx(fisher_exact([[56, 14], [48, 32]]).pvalue)


def test_a_rate_says_what_its_episodes_can_tell_and_the_scripted_policy_lacks_no_training_seeds():
    few, many = gap(exact("a", "S", 4, 4) + exact("expert", "S", 4, 4)), gap(exact("a", "S", 1960, 2000))
    assert [(r["words"], r["needed"]) for r in few["success"]] == [("4 of 4: 51 to 100 %", 384)] * 2
    assert many["success"][0]["needed"] is None
    networks = gap([e for t in range(3) for e in exact("a", "S", 2 + t, 4, t)])
    assert networks["success"][0]["needed"] is None, "more episodes do not make three networks more"
    assert [n for n in few["notes"] if "training seed" in n] == [n for n in few["notes"] if n.startswith("a ")] != []
    assert [(p["scripted"], p["train_seeds"]) for p in few["policies"]] == [(False, [0]), (True, [])]


def test_a_robot_that_takes_longer_and_presses_harder_is_told_so():
    from dataclasses import replace

    def timed(time, force, world, digest, n=20):
        rng = stream(0, world, str(force))
        head = ("a", "depth", 0, world, digest)
        each = [(s, float(rng.normal(time, 0.3)), float(rng.normal(force, 4))) for s in range(n)]
        return [Episode(*head, s, True, "success", time=t, peak_force=f) for s, t, f in each]

    sim = timed(2.0, 57, "S", "h")
    rows = gap(sim + timed(5.35, 117, "robot", ""))["measures"]
    assert [(r["measure"], r["verdict"], r["apart"]) for r in rows] == [
        ("time", "different", False),
        ("peak_force", "different", True),
    ]
    assert f"a in robot: {rows[1]['words']}" in gap(sim + timed(5.35, 117, "robot", ""))["notes"], (
        "the page shows notes"
    )
    assert "longer" in rows[0]["words"] and "more than half apart: look at the contact model" in rows[1]["words"]
    near = gap(sim + timed(2.0, 66, "robot", ""))["measures"]
    assert [(r["verdict"], r["apart"]) for r in near] == [(CANNOT_TELL, False), ("different", False)]
    freely = [replace(e, peak_force=0.0) for e in sim]  # half of the robot's touch, and none of the simulation's
    touched = [replace(e, world="robot", world_hash="", peak_force=5.0 * (e.seed > 10)) for e in freely]
    (_, force) = gap(freely + touched)["measures"]
    assert force["verdict"] == "different" and force["words"].startswith("the peak force is 0 N on both sides in the")
    assert gap(sim + timed(5.0, 117, "P", "other world"))["measures"] == [], "that is what the tables show"
    grid = [replace(e, time=1.28) for e in sim]  # and the same on a robot's clock, as differences of its readings
    clocked = [replace(e, world="robot", world_hash="", time=1e6 + 1.28 - 1e6) for e in grid]
    assert clocked[0].time != 1.28 and gap(grid + clocked)["measures"][0]["p"] == 1.0
    untold = [replace(e, time=math.nan, peak_force=math.nan) for e in timed(5.0, 117, "robot", "")]
    assert gap(sim + untold)["measures"] == []


def test_pairing_takes_only_shared_seeds():
    table = Table(exact("a", "S", 50) + exact("a", "T", 50)[:60])
    y = table.aligned("a", ["S", "T"])
    assert y["S"].shape == (1, 60) and np.array_equal(y["S"], y["T"])
    assert Table(exact("a", "S", 1, 5)[:2] + exact("a", "T", 1, 5)[3:]).aligned("a", ["S", "T"]) is None
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
    p = [part(*ends(*(rng.choice(names, 60, p=[0.5, 0.3, 0.2]) for _ in "ab")), rng, 400).p for _ in range(200)]
    assert np.mean(np.array(p) < 0.05) < 0.1
    found = part(*ends(["search"] * 30 + ["jam"] * 10, ["search"] * 10 + ["jam"] * 30 + ["success"] * 50), rng)
    assert found.p < 0.001 and found.where in ("jam", "search") and found.second == {"search": 10, "jam": 30}
    one = part(*ends(["jam"] * 9, ["jam"] * 20), rng)
    assert one.p == 1.0 and one.residual == 0.0


def test_few_failures_are_compared_too_and_where_they_say_nothing_the_record_says_so():
    rng = stream(0, "few")
    first, second = ["jam"] * 3 + ["success"] * 37, ["search"] * 4 + ["slip"] * 5 + ["success"] * 31
    found = part(*ends(first, second), rng)
    assert found.p == pytest.approx(1 / math.comb(12, 3)) and found.where == "jam"
    tables = [[[3, 0], [0, 9]], [[3, 37], [0, 40]], [[0, 40], [5, 35]]]
    assert found.p == pytest.approx(fisher_exact(tables[0]).pvalue)  # the three jams against all others
    assert {k.category: k.test.p for k in found.kinds}["jam"] == pytest.approx(fisher_exact(tables[1]).pvalue)
    few = part(*ends(["jam"] * 2, ["jam", "slip", "slip"]), rng)
    assert (
        few.p > 0.05 and CANNOT_TELL == decided(few)["verdict"] and CANNOT_TELL in decided(few)["words"] and few.where
    )

    sure = part(
        *ends(["success"] * 40, ["success"] * 11 + ["search"] * 8 + ["dropped"]), rng
    )  # the usual case of a robot
    said = decided(sure)
    assert sure.p == 1.0 and said["verdict"] == CANNOT_TELL
    assert [(k["category"], k["verdict"]) for k in said["kinds"]] == [("search", "more"), ("dropped", CANNOT_TELL)]
    assert sure.kinds[0].test.p == pytest.approx(fisher_exact([[0, 40], [8, 12]]).pvalue)
    assert "more search: 0 to 40 % of the episodes" in said["words"]
    none = part(*ends(["success"] * 4, ["success"] * 4), rng)
    assert decided(none)["words"] == "no failure on either side" and none.kinds == ()
    assert None not in (*decided(found).values(), *said.values(), *decided(none).values())


def failing(networks, share, wins=60, n=100):
    """Episodes of networks that fail from `wins` on, the share of each by jam, else by search."""
    row = {i: "success" if i < wins else "jam" if i * 7 % 10 < 10 * share else "search" for i in range(n)}
    return dict.fromkeys(range(networks), row)


def test_networks_are_the_unit_of_how_they_fail_too():
    """Two networks say nothing, however many episodes; three that all fail otherwise do."""
    rng = stream(0, "networks")
    two = decided(part(failing(2, 0.1), failing(2, 0.9), rng))
    assert two["verdict"] == CANNOT_TELL and two["p"] is None and "2 training seeds" in two["words"]
    assert {k["verdict"] for k in two["kinds"]} == {CANNOT_TELL} and {k["p"] for k in two["kinds"]} == {None}
    three = decided(part(failing(3, 0.1), failing(3, 0.9), rng))
    assert three["verdict"] == "different" and {k["verdict"] for k in three["kinds"]} == {"more", "fewer"}
    one_of_three = {**failing(3, 0.1), 2: failing(1, 0.9)[0]}  # what one network does is none of the recipe's
    assert decided(part(failing(3, 0.1), one_of_three, rng))["verdict"] == CANNOT_TELL
    more = decided(part(failing(3, 0.5, wins=80), failing(3, 0.5, wins=20), rng))  # more failures, of the same kinds
    assert more["verdict"] == CANNOT_TELL and {k["verdict"] for k in more["kinds"]} == {"more"}


def test_listed_and_drawn_tables_agree(monkeypatch):
    rng = stream(0, "drawn")
    sides = ends(["a"] * 6 + ["b"] * 2 + ["c"] * 3, ["a"] * 3 + ["b"] * 8 + ["c"] * 4)
    listed = part(*sides, rng).p
    monkeypatch.setattr("vispeg.evaluation.categories.MOST_TABLES", 0)
    assert part(*sides, rng, 40_000).p == pytest.approx(listed, abs=0.01)


def test_the_largest_residual_is_the_two_proportion_z():
    found = part(*ends(["a"] * 12 + ["b"] * 28 + ["c"] * 20, ["a"] * 30 + ["b"] * 12 + ["c"] * 18), stream(0, "z"))
    pooled = 42 / 120
    z = (30 / 60 - 12 / 60) / np.sqrt(pooled * (1 - pooled) * (2 / 60))
    assert found.where == "a" and found.residual == pytest.approx(z)


def test_prediction_over_checkpoints_counts_bad_ones():
    episodes = []
    for i in range(9):
        episodes += exact(f"step{i}", "S", 10 + 10 * i) + exact(f"step{i}", "T", 5 + 10 * i)
    row = gap(episodes)["prediction"][0]
    assert row["pearson"]["value"] > 0.99 and row["mean_difference"]["value"] == pytest.approx(0.05)
    assert row["mmrv"] == 0 and row["ordered"] > 20 and row["words"].startswith("r = 1.00")
    assert CANNOT_TELL in gap(episodes[:400])["prediction"][0]["words"]


def test_replicas_of_a_policy_are_one_policy():
    """Two recipes of four networks each, of which one world says nothing of the other, are two points, not eight."""
    rng = stream(0, "replicas")
    two = [
        e for p in "ab" for t in range(4) for w in "ST" for e in exact(p, w, int(rng.integers(20, 80)), train_seed=t)
    ]
    row = gap(two)["prediction"][0]
    assert row["n"] == 2 and row["pearson"]["value"] is None and CANNOT_TELL in row["words"]
    assert row["mean_difference"]["low"] is None and len(row["points"]) == 8
    held = 0
    for _ in range(10):  # eight recipes of three networks, true correlation 0
        luck = {(p, w): rng.uniform(20, 80) for p in "abcdefgh" for w in "ST"}
        draw = {
            (*k, t): int(np.clip(x + 10 * rng.standard_normal(), 0, 100)) for k, x in luck.items() for t in range(3)
        }
        found = gap([e for (p, w, t), n in draw.items() for e in exact(p, w, n, train_seed=t)])["prediction"][0]
        held += CANNOT_TELL not in found["words"]
    assert held <= 2


def test_a_robot_of_one_trial_says_nothing_and_breaks_nothing():
    found = gap(exact("a", "S", 1, 1) + trials("a", 0, 1))
    assert found["gaps"][0]["verdict"] == CANNOT_TELL and json.dumps(found, allow_nan=False)


def test_unknown_worlds_are_named():
    with pytest.raises(UserError, match="no episodes in this world.*'X'.*choices: S"):
        gap(exact("a", "S", 50), worlds=["S", "X"])
    with pytest.raises(UserError, match="no episodes in this world"):
        gap(exact("a", "T", 50))
