"""Suite, sweeps, pushes and the exploitation test on records with known answers; the lists in the package."""

from dataclasses import replace

import pytest

from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.evaluation import suite
from vispeg.evaluation.overlay import overlay
from vispeg.evaluation.records import Episode
from vispeg.evaluation.statistics import CANNOT_TELL, wilson
from vispeg.evaluation.stress import exploit, perturb, sensitivity
from vispeg.robots.scene import build
from vispeg.worlds.model_file import model_text
from vispeg.worlds.world import World


def wins(world, configuration, count, n=40, policy="a", force=20.0, profile=None):
    head = ("state", 0, world, f"h-{world}-{configuration}")
    return [
        Episode(
            policy,
            *head,
            s,
            s < count,
            "success" if s < count else "jam",
            peak_force=force + s % 5,
            configuration=configuration,
            force_profile=profile,
        )
        for s in range(n)
    ]


def two_worlds(train, target):
    return [
        e
        for i, (x, y) in enumerate(zip(train, target, strict=True))
        for e in wins("S", f"c{i}", x) + wins("T", f"c{i}", y)
    ]


RISING = list(range(4, 40, 4))


@pytest.mark.parametrize(
    ("target", "status"),
    [
        (RISING, "healthy"),
        (RISING[::-1], "alarm"),
        ([12, 4, 24, 4, 30, 10, 28, 24, 36], CANNOT_TELL),  # r = .77 of nine
        ([38] * 9, CANNOT_TELL),
    ],
)
def test_health_is_the_articles_traffic_light_on_the_interval(target, status):
    found = suite.summarise(two_worlds(RISING, target), "S", "T", "v1")["health"]
    assert found["status"] == status, found["words"]
    r = found["pearson"]
    assert r["low"] <= r["value"] <= r["high"]
    assert (r["low"] > 0.6) == (status == "healthy") and (r["high"] < 0.6) == (status == "alarm")


@pytest.mark.parametrize(("count", "n"), [(9, 20), (6, 20), (16, 20)])
def test_two_worlds_that_are_the_same_raise_no_alarm(count, n):
    """All rates 90 %, the default episodes: a correlation of what chance leaves called 49 to 71 % of them."""
    rng = stream(0, "the same", str(count))
    for _ in range(12):
        drawn = [(rng.uniform(size=(2, n)) < 0.9) for _ in range(count)]
        episodes = [
            replace(e, success=bool(ok), category="success" if ok else "jam")
            for i, both in enumerate(drawn)
            for world, row in zip("ST", both, strict=True)
            for e, ok in zip(wins(world, f"c{i}", n, n), row, strict=True)
        ]
        found = suite.summarise(episodes, "S", "T", "v")["health"]
        assert found["status"] == CANNOT_TELL, found["words"]
        assert count < 8 or "these episodes cannot tell" in found["words"]


def test_too_few_configurations_cannot_tell():
    assert suite.summarise(two_worlds([1, 20, 39], [1, 20, 39]), "S", "T", "v")["health"]["status"] == CANNOT_TELL
    with pytest.raises(UserError, match="both worlds"):
        suite.summarise(wins("S", "c0", 3), "S", "T", "v")


@pytest.mark.parametrize("configurations", [1, 2, 9])
def test_a_fall_beyond_doubt_is_an_alarm_whatever_the_correlation(configurations):
    full, lower = [40] * configurations, [26] * configurations
    found = suite.summarise(two_worlds(full, lower), "S", "T", "v")
    assert found["health"]["status"] == "alarm" and found["health"]["words"].startswith("alarm: a loses 35 points (")
    assert found["falls"][0]["beyond_doubt"] and found["falls"][0]["fall"]["value"] == pytest.approx(0.35)
    assert suite.summarise(two_worlds(lower, full), "S", "T", "v")["health"]["status"] == CANNOT_TELL, "a rise is none"
    assert suite.summarise(two_worlds(full, full), "S", "T", "v")["health"]["status"] == CANNOT_TELL
    measured = [replace(e, world_hash="") if e.world == "T" else e for e in two_worlds(full, lower)]
    robot = suite.summarise(measured, "S", "T", "v")
    assert robot["health"]["status"] == "alarm" and robot["falls"][0]["fall"]["low"] > 0.05


def test_a_correlation_is_not_healthy_over_a_fall():
    lower = [n - 4 for n in RISING]  # ranks every configuration as the training world does, 10 points lower
    found = suite.summarise(two_worlds(RISING, lower), "S", "T", "v")["health"]
    assert found["pearson"]["value"] > 0.97 and found["status"] == "alarm" and "r = " in found["words"]


def test_a_suite_of_a_robots_trials_takes_the_network_that_was_tried():
    """Two networks at 95 and 10 % in simulation; the first was tried, as well as it is, and trials are numbered on."""
    episodes, number = [], 0
    for i in range(9):
        for t, rate in enumerate((38, 4)):
            episodes += [replace(e, train_seed=t) for e in wins("S", f"c{i}", rate)]
        for e in wins("T", f"c{i}", 19, 20):
            number += 1
            episodes.append(replace(e, seed=number, world_hash=""))
    (lost,) = suite.summarise(episodes, "S", "T", "v")["falls"]
    assert lost["fall"]["value"] == pytest.approx(0.0) and not lost["beyond_doubt"]


def test_a_regression_is_found_where_it_is_and_chance_is_not_one():
    old = two_worlds([36] * 9, [30] * 9)
    new = two_worlds([36] * 9, [30] * 8 + [10])
    rows = suite.regressions(old, new)
    assert [(r["world"], r["configuration"]) for r in rows if r["verdict"] == "fell"] == [("T", "c8")]
    assert {r["verdict"] for r in suite.regressions(new, old)} >= {"rose"}
    nearly = two_worlds([36] * 9, [30] * 8 + [27])
    assert not [r for r in suite.regressions(old, nearly) if r["verdict"] == "fell"]


def test_versions_are_compared_in_the_same_world_on_the_same_seeds_only():
    old = wins("T", "c0", 30)
    moved = [replace(e, world_hash="another") for e in wins("T", "c0", 5)]
    with pytest.raises(UserError, match="no configuration in common"):
        suite.regressions(old, moved)
    renamed = [replace(e, policy="b") for e in wins("T", "c0", 5)]
    assert suite.regressions(old, renamed)[0]["verdict"] == "fell"
    with pytest.raises(UserError, match="no policy in common"):
        suite.regressions(old + wins("T", "c0", 3, policy="z"), renamed)


def test_a_robots_trials_of_two_versions_are_independent_samples():
    """Fisher's exact test of 20 of 20 against 13 of 20: equal numbers of trials are not equal starts."""
    from scipy.stats import fisher_exact

    old, new = ([replace(e, world_hash="") for e in wins("robot", "c0", count, 20)] for count in (20, 13))
    for version in (new, [replace(e, policy="b") for e in new], [replace(e, seed=e.seed + 100) for e in new]):
        (row,) = suite.regressions(old, version)
        assert row["p_holm"] == pytest.approx(fisher_exact([[20, 0], [13, 7]]).pvalue, rel=1e-6)
        assert row["verdict"] == "fell" and row["change"]["value"] == pytest.approx(-0.35)


def test_a_suites_result_tells_the_hash_of_every_world(tmp_path):
    found = suite.summarise(two_worlds(RISING, RISING), "S", "T", "v", {"S": "aa", "T": "bb"})
    hashes = {w["name"]: w["hash"] for w in found["worlds"]}
    assert (hashes["S"], hashes["T"], hashes["S / c0"], len(hashes)) == ("aa", "bb", "h-S-c0", 2 + 2 * 9)


def test_versions_from_other_worlds_are_refused_or_named():
    def version(name, target="bb", **worlds):
        made = {"S": "aa", "T": target, "T / c0": "c", **worlds}
        return {"version": name, "train": "S", "target": "T", "worlds": [{"name": k, "hash": made[k]} for k in made]}

    assert suite.other_worlds([version("v1"), version("v2")]) == []
    moved = suite.other_worlds([version("v1"), version("v2", **{"T / c0": "d", "T / new": "e"})])
    assert moved == ["v1: made in other worlds than v2: T / c0"]
    (line,) = suite.other_worlds([{**version("v1"), "worlds": None}, version("v2")])
    assert "v1: does not tell" in line
    for other in ("zz", ""):
        with pytest.raises(UserError, match="target: versions v1 and v3 were made in different worlds"):
            suite.other_worlds([version("v1"), version("v2"), version("v3", other)])


def test_the_suite_and_the_positions_that_come_with_the_package_can_be_built(tmp_path):
    listed = suite.configurations()
    assert len(listed) == 16
    hashes = {
        overlay(s.world, f"{i}", tmp_path, s.changes, s.task).hash
        for i, s in enumerate(suite.settings(listed, {"S": "randomized"}))
    }
    assert len(hashes) == len(listed)  # every configuration changes something
    found = perturb.settings("randomized", "S", perturb.positions())
    assert len(found) == 2 * (1 + 8)
    still, pushed = found[:9], found[9:]
    assert all(s.pushes is None for s in still) and all(s.pushes is not None for s in pushed)
    for s in still:
        overlay(s.world, s.configuration, tmp_path, s.changes, s.task)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("format: x\n", "unknown format"),
        ("format: vispeg-suite/1\n", "no entries"),
        ("format: vispeg-suite/1\nconfigurations: [{task: {}}]\n", "without a name"),
        ("format: vispeg-suite/1\nconfigurations: [{name: a, tsak: {}}]\n", "did you mean 'task'"),
        ("format: vispeg-suite/1\nconfigurations: [{name: a}, {name: a}]\n", "share a name"),
        ("format: [\n", "is not YAML"),
    ],
)
def test_a_bad_suite_is_one_clear_line(tmp_path, text, words):
    (tmp_path / "s.yaml").write_text(text)
    with pytest.raises(UserError, match=words):
        suite.configurations(tmp_path / "s.yaml")


def test_a_sweep_is_read_and_always_has_the_null_value():
    s = sensitivity.sweep("contact_friction@peg.scale=0.5,2")
    assert s.values == (0.5, 1.0, 2.0) and s.where == "peg" and s.null == 1.0
    for name, known in sensitivity.SWEEPS.items():
        assert known.null in known.values, name
    for text, words in {
        "friktion": "unknown sweep.*choices",
        "contact_friction.scael=1": "did you mean 'scale'",
        "contact_fricton.scale=1": "did you mean 'contact_friction'",
        "contact_friction.scale=x": "not numbers",
        "contact_friction.scale=99": "out of bounds",
        "lens_distortion.k1,k2=0.1": "out of bounds; expected -0.05 to 0.05",
        "camera_offset.x,rx=0.04": "cannot take the same values.*got 'x 0 m, rx 0 rad'",
        "gripper_slip.grip,viscosity=1.5": "cannot take the same values",
    }.items():
        with pytest.raises(UserError, match=words):
            sensitivity.sweep(text)


def test_what_a_diagnosis_named_is_swept_from_nothing_to_its_value(tmp_path):
    offset = EffectInstance.of("camera_offset", "wrist_wide", x=0.004, rz=-0.01)
    scale = EffectInstance.of("depth_scale", "external", factor=1.05)
    file = tmp_path / "model.yaml"
    file.write_text(model_text(World("iiwa14").add(offset, scale)))
    one, other = sensitivity.sweeps(str(file), "iiwa14")
    assert one.where == "wrist_wide" and one.values == (0.0, 1.0) and one.label == "camera_offset(wrist_wide)"
    assert one.at(1.0) == {p: v.value for p, v in offset.params.items()} and set(one.at(0.0).values()) == {0.0}
    assert other.at(0.0) == {"factor": 1.0} and other.at(1.0) == {"factor": 1.05} and other.null == 0.0
    (null, found) = sensitivity.settings("S", "S", other)
    made = [overlay(s.world, s.configuration, tmp_path, s.changes, s.task).world for s in (null, found)]
    drawn = [[e for e in w.sample(3, build()).effects if e.effect == "depth_scale"] for w in made]
    assert [e.params["factor"].value for some in drawn for e in some if e.where == "external"] == [1.0, 1.05]
    counts = {0.0: 40, 1.0: 20}
    played = [e for v, n in counts.items() for e in wins("S", sensitivity.tag(other, v), n)]
    (record,) = sensitivity.summarise(played, [other])
    (curve,) = record["curves"]
    assert curve["points"][1]["cost"]["value"] == 0.5 and record["unit"] == "times the value found"
    (tmp_path / "bare.yaml").write_text(model_text(World("iiwa14")))
    with pytest.raises(UserError, match="has no effect to sweep"):
        sensitivity.sweeps(str(tmp_path / "bare.yaml"), "iiwa14")


def test_sweeps_of_one_effect_at_two_places_are_told_apart(tmp_path):
    asked = [sensitivity.sweep(f"backlash@joint{j}.gap=0.001") for j in (1, 2)]
    assert [what.label for what in asked] == ["backlash@joint1.gap", "backlash@joint2.gap"]
    counts = {(1, 0.0): 40, (1, 0.001): 40, (2, 0.0): 40, (2, 0.001): 10}
    played = [e for (j, v), n in counts.items() for e in wins("S", sensitivity.tag(asked[j - 1], v), n)]
    found = sensitivity.summarise(played, asked)
    assert [r["curves"][0]["points"][1]["success"]["value"] for r in found] == [1.0, 0.25]
    everywhere = sensitivity.sweep("backlash.gap=0.001")
    assert everywhere.label == "backlash.gap" and everywhere.where == "*"


def test_a_sweep_at_no_place_of_the_cell_is_refused_by_its_option(tmp_path, monkeypatch, capsys):
    from vispeg.cli.main import main

    monkeypatch.chdir(tmp_path)
    argv = "sensitivity expert --world nominal --sweep command_delay@elbow.delay=0.01 --out o"
    assert main(argv.split()) == 2 and not [*tmp_path.iterdir()]
    assert "error: --sweep: command_delay has no such place; got 'elbow'; choices: joint1" in capsys.readouterr().err


def test_a_sweep_whose_last_value_is_null_has_its_curve():
    what = sensitivity.sweep("contact_friction.scale=0.25,0.5")
    counts = {0.25: 10, 0.5: 40, 1.0: 40}
    ((curve,),) = [r["curves"] for r in sensitivity.summarise(
        [e for v, n in counts.items() for e in wins("S", sensitivity.tag(what, v), n)], [what])]  # fmt: skip
    assert what.null == what.values[-1] and curve["falls_at"] == 0.25


def test_every_named_sweep_can_be_built(tmp_path):
    for name, known in sensitivity.SWEEPS.items():
        for s in sensitivity.settings("nominal", "S", known)[-1:]:
            overlay(s.world, name, tmp_path, s.changes, s.task)


def test_a_curve_falls_where_it_falls():
    what = sensitivity.Sweep("contact_friction", ("scale",), (0.5, 1.0, 2.0, 3.0))
    counts = {0.5: 39, 1.0: 40, 2.0: 38, 3.0: 12}
    played = [e for v, n in counts.items() for e in wins("S", sensitivity.tag(what, v), n)]
    (found,) = sensitivity.summarise(played, [what])
    (curve,) = found["curves"]
    assert curve["falls_at"] == 3.0
    assert [p["success"]["value"] for p in curve["points"]] == [n / 40 for n in counts.values()]
    assert curve["points"][0]["success"]["low"] == pytest.approx(wilson(39, 40).low)
    flat = [e for v in counts for e in wins("S", sensitivity.tag(what, v), 30, 60)]
    assert sensitivity.summarise(flat, [what])[0]["curves"][0]["words"].startswith(CANNOT_TELL)
    many = [e for v in counts for e in wins("S", sensitivity.tag(what, v), 190, 200)]
    assert sensitivity.summarise(many, [what])[0]["curves"][0]["words"].startswith("holds over 0.5 to 3")


def test_a_push_that_costs_is_told_from_one_that_does_not():
    episodes = wins("S", "far corner", 40) + wins("S", "far corner, pushed", 20)
    episodes += wins("S", "anywhere", 40) + wins("S", "anywhere, pushed", 40)
    rows = {r["position"]: r for r in perturb.summarise(episodes)["rows"]}
    assert rows["far corner"]["verdict"] == "different" and rows["far corner"]["cost"]["value"] == 0.5
    assert rows["anywhere"]["cost"]["value"] == 0 and rows["anywhere"]["verdict"] == CANNOT_TELL


def test_pushes_that_cost_nothing_are_rarely_called_at_nine_positions():
    """The rule of before called one on 35 to 43 % of such pages."""
    rng, called = stream(0, "pushes"), 0
    for _ in range(40):
        places = [f"p{i}{side}" for i in range(9) for side in ("", ", pushed")]
        drawn = [(e, rng.uniform() < 0.8) for c in places for e in wins("S", c, 0)]
        rows = perturb.summarise([replace(e, success=ok) for e, ok in drawn])["rows"]
        called += any(r["verdict"] == "different" for r in rows)
    assert called <= 5


def exploitation(fixed, heavy, n=100):
    rise, spike = tuple([0.0] * 5 + [10.0] * 20), tuple([0.0] * 3 + [30.0] * 20)
    out = wins("S", "fixed", fixed, n, profile=rise)
    rng = stream(0, "substeps")
    for e in wins("S", "x", heavy, n, force=40.0, profile=spike):
        out.append(replace(e, configuration=f"randomized, {rng.choice([3, 5, 8])} substeps"))
    return out


def test_exploitation_is_told_and_forces_are_aligned_at_contact():
    (found,) = exploit.summarise(exploitation(98, 40))["policies"]
    assert found["verdict"] == "exploits" and "58 points" in found["words"]
    assert found["profiles"]["fixed"]["median"][0] == 10.0 and found["profiles"]["randomized"]["median"][0] == 30.0
    assert found["peak"]["randomized"] > found["peak"]["fixed"] and found["peak"]["p"] < 1e-6
    assert sum(s["n"] for s in found["substeps"].values()) == 100
    (same,) = exploit.summarise(exploitation(98, 97))["policies"]
    assert same["verdict"] == "does not exploit"
    (few,) = exploit.summarise(exploitation(9, 8, 10))["policies"]
    assert few["verdict"] == CANNOT_TELL


def test_the_randomized_trials_share_seeds_with_the_fixed_ones_and_out_the_time_steps(tmp_path):
    planned = exploit.settings("randomized", "S", range(100))
    assert planned[0][1] == list(range(100)) and sorted(s for _, part in planned[1:] for s in part) == list(range(100))
    assert {s.task["substeps"] for s, _ in planned[1:]} == set(exploit.SUBSTEPS)
    worlds = [overlay(s.world, str(i), tmp_path, s.changes, s.task) for i, (s, _) in enumerate(planned)]
    assert len({w.hash for w in worlds}) == len(worlds)
    stiff = [r for r in worlds[0].world.ranges if r.effect == "contact_stiffness"]
    assert [dict(r.params) for r in stiff] == [{"scale": 1.0}]
