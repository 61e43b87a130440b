"""What a diagnosis leaves open, priced: worlds that say what they should, a cost that is what was put in."""

import pytest

from vispeg.api.stress.remainder import Price
from vispeg.core.effect import EffectInstance, effect, searchable
from vispeg.core.errors import UserError
from vispeg.core.params import Value
from vispeg.evaluation.records import Episode
from vispeg.evaluation.stress.remainder import IDENTIFIED, LEFT, settings, summarise
from vispeg.report.text import words
from vispeg.robots.model import load
from vispeg.robots.scene import build
from vispeg.task.world_file import load_world
from vispeg.worlds.world import World

FRICTION = EffectInstance("coulomb_friction", "joint4", {"torque": Value(1.3, 1.1, 1.5)})
MISSING = [{"joint": f"joint{j}", "rms": 0.1 * (j - 1)} for j in range(1, 8)]


def drawn(setting, seed):
    return {(e.effect, e.where): e.params for e in load_world(setting.world).world.sample(seed, build()).effects}


def test_the_identified_world_stands_still_and_the_other_takes_in_the_intervals_and_the_missing_torque(tmp_path):
    base = load_world("nominal")
    fixed, left = settings(base, World("iiwa14").add(FRICTION), MISSING, tmp_path)
    assert (fixed.configuration, left.configuration) == (IDENTIFIED, LEFT)
    torques = {name: [drawn(s, seed)["coulomb_friction", "joint4"]["torque"].value for seed in range(40)]
               for name, s in (("fixed", fixed), ("left", left))}  # fmt: skip
    assert set(torques["fixed"]) == {1.3}
    assert len(set(torques["left"])) == 40 and 0.05 < sum(abs(t - 1.3) for t in torques["left"]) / 40 < 0.15
    noise = {where: p["rms"].value for (name, where), p in drawn(left, 0).items() if name == "torque_noise"}
    assert noise == pytest.approx({r["joint"]: r["rms"] for r in MISSING if r["rms"] > 0})
    assert not any(name == "torque_noise" for name, _ in drawn(fixed, 0))
    assert drawn(left, 1)["torque_noise", "joint3"]["seed"] != drawn(left, 2)["torque_noise", "joint3"]["seed"]


def test_whatever_a_diagnosis_can_name_in_the_arm_has_its_place_in_the_cell(tmp_path):
    arm = load("iiwa14")
    for name, kind in searchable().items():
        if kind.channels() == {"servo", "load"}:  # the cell's arm is sent torques
            continue
        for where in kind.targets(arm)[:1]:
            placed = EffectInstance.of(name, where, **{m: kind.params[m].start for m in kind.magnitudes})
            fixed, _ = settings(load_world("nominal"), World("iiwa14").add(placed), [], tmp_path)
            assert (name, where) in drawn(fixed, 0), name


def test_another_robots_model_is_refused_before_anything_is_played():
    with pytest.raises(UserError, match="another robot"):
        Price.of("expert", "nominal", 4, World("panda"))
    with pytest.raises(UserError, match="episodes"):
        Price.of("expert", "nominal", 0, World("iiwa14"))


def wins(setting, first, last, n=100):
    head = ("expert", "state", 0, "nominal", f"h-{setting}")
    return [Episode(*head, s, ok, "success" if ok else "jam", configuration=setting)
            for s in range(n) for ok in [first <= s < last]]  # fmt: skip


def test_the_cost_is_paired_over_seeds_and_said_in_points():
    # 90 and 80 of 100 succeed; of the pairs 20 are lost and 10 won
    (row,) = summarise([*wins(IDENTIFIED, 0, 90), *wins(LEFT, 20, 100)])
    assert row["identified"]["value"] == pytest.approx(0.9) and row["left"]["value"] == pytest.approx(0.8)
    assert row["cost"]["value"] == pytest.approx(0.1)
    low, high = row["cost"]["low"] or 0.0, row["cost"]["high"] or 0.0
    assert -0.02 < low < 0.0 < 0.19 < high < 0.22  # 0.1 +- 1.96 sqrt(.3 - .01) / 10
    (said,) = words.paid({"cost": {"world": {"name": "nominal"}, "policies": [row]}})
    assert said.startswith("what is left costs expert 10 points of success [-1, 21]: 90 % with the identified model")
    assert words.price({"cost": {"policies": [row]}, "remainder": MISSING}) == ""


def test_the_scripted_expert_pays_for_a_torque_that_throws_the_arm_about_and_hardly_for_a_small_one(tmp_path):
    price = Price.of("expert", "nominal", 6, World("iiwa14"))
    costs = []
    for rms in (0.02, effect("torque_noise").params["rms"].high):
        left = [{"joint": f"joint{j}", "rms": rms} for j in range(1, 8)]
        paid = price.paid(World("iiwa14").add(FRICTION), left, seed=0, part=tmp_path / "part", say=lambda text: None)
        assert not (tmp_path / "part").exists() and paid["episodes"] == 6
        costs.append(paid["policies"][0])
    assert costs[0]["identified"]["value"] == costs[1]["identified"]["value"] >= 5 / 6
    assert costs[0]["cost"]["value"] <= 1 / 6 < 4 / 6 <= costs[1]["cost"]["value"]
