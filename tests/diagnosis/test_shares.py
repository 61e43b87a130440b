"""What each effect explains: the error without it is that of a model file without it, and the page says the same."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from loops import hinge, pendulum, swings

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.compare import compare
from vispeg.diagnosis.conclusion.shares import share, shares
from vispeg.diagnosis.run import diagnose
from vispeg.diagnosis.selection.judge import Judge
from vispeg.identify.inverse import evidence_for
from vispeg.worlds.model_file import load_model, write_model
from vispeg.worlds.world import World

BOTH = hinge("viscous_friction", damping=0.5).add(EffectInstance.of("joint_bias", "hinge", torque=0.4))


def recordings(hidden: World):
    """Three swings of a pendulum with hidden effects, each by a name of its own."""
    return [replace(rec, path=Path(f"swing-{i}")) for i, rec in enumerate(swings(hidden, 3, 3.0))]


def compared_without(world: World, k: int, folder: Path, recording):
    """Return the record of comparing the file of a model from which the effect number k was deleted."""
    path = write_model(folder / f"without-{k}.yaml", world)
    data = yaml.safe_load(path.read_text())
    del data["effects"][k]
    path.write_text(yaml.safe_dump(data))
    return compare(load_model(path), [recording]).record


def times(record) -> float:
    return record["ladder"][-1]["heldout_error"] / record["noise_floor"]["value"]


def test_what_an_effect_explains_is_what_models_without_it_and_without_any_lack(tmp_path):
    *_, held = recordings(BOTH)
    world = replace(BOTH, robot=pendulum().source)
    judge = Judge(evidence_for([held], 1))
    nominal = World(world.robot)
    before, after = (judge.mean(loss) for loss in judge.losses([nominal, world]))
    found = shares(judge, world, 0, before, after, judge.floor(world))
    assert [*found] == [e.label for e in world.effects]
    right, bare = (compare(w, [held]).record for w in (world, nominal))
    for k, e in enumerate(world.effects):
        record = compared_without(world, k, tmp_path, held)
        assert found[e.label]["without"] == pytest.approx(times(record), rel=1e-9) and times(record) > 5
        explains = (record["chi2"] - right["chi2"]) / (bare["chi2"] - 1.0)
        assert found[e.label]["explains"] == pytest.approx(explains, abs=1e-4)
    assert shares(judge, nominal, 0, before, before, 1.0) == {}


def test_where_the_user_s_model_is_at_the_floor_there_is_nothing_to_share():
    assert share(2.0, 4.0, before=1.2, after=1.0) == {"without": 2.0}
    assert share(2.0, 4.0, before=1.5, after=1.0)["explains"] == 6.0, "more than all where effects compensate"
    assert share(np.inf, np.inf, before=9.0, after=1.0) == {}


@pytest.mark.slow
def test_of_two_found_effects_json_model_file_and_page_say_the_same(tmp_path):
    from vispeg.report.build import read

    *fitted, held = recordings(BOTH)
    found = diagnose(World(pendulum().source), fitted, [held], nthread=1, plan_next=False)
    record = found.record
    assert {e["effect"] for e in record["effects"]} == {e.effect for e in BOTH.effects}
    (tmp_path / "diagnosis.json").write_text(json.dumps(record))
    page = read(tmp_path)
    for k, e in enumerate(record["effects"]):
        without = times(compared_without(found.world, k, tmp_path, held))
        assert e["without"] == pytest.approx(without, rel=1e-3), "a model file has five digits"
        assert 0 < e["explains"]
        assert f"explains {100 * e['explains']:.1f} % of the excess" in re.sub(r"\s+", " ", page)
