"""The studies of training options ask for runs that can be, and differ in what they are named for alone."""

from dataclasses import replace

import pytest
from curve_picture import draw
from curves import Curve, together
from training import Budget, Variant, configuration
from training_options import STUDIES

from vispeg.learn.config import Stage, TrainConfig
from vispeg.task.environments.vector import world_of

BUDGET = Budget(200, 100, 5)
DIFFER = {
    "reward": {"name", "reward"},
    "stack": {"name", "stack"},
    "teacher": {"name", "modality"},
    "turn": {"name", "dof"},
}


@pytest.mark.parametrize("name", STUDIES)
def test_a_studys_policies_differ_in_one_thing_and_can_be_trained(name):
    variants = [*STUDIES[name].variants.values()]
    first = variants[0]
    for variant in variants:
        config = configuration(variant, 1, BUDGET)
        task = world_of(config.world, dict(config.settings))[1]
        assert (task.reward, task.dof, task.stack) == (variant.reward, variant.dof, variant.stack)
        assert config.modality == variant.modality
        assert replace(variant, **{key: getattr(first, key) for key in DIFFER[name]}) == first
    for world in STUDIES[name].worlds:
        assert world_of(world, {})[2] is not None


def test_gated_ranges_open_by_what_is_learned_and_end_whole():
    config = configuration(Variant("gated", "randomized", ranges="gated"), 1, BUDGET)
    assert [stage.level for stage in config.stages] == [0.0, 0.5, 1.0] and config.ranges == "full"
    assert configuration(Variant("whole", "randomized"), 1, BUDGET) == replace(
        config, stages=(Stage(),), pass_rate=TrainConfig.pass_rate
    )


def test_runs_of_one_name_are_one_run_wherever_they_stand():
    """Studies share folders by name."""
    known: dict[str, Variant] = {}
    for variant in (v for study in STUDIES.values() for v in study.variants.values()):
        assert known.setdefault(variant.name, variant) == variant


def test_the_picture_shows_returns_where_there_are_any(tmp_path):
    import numpy as np

    steps = np.array([10, 20])
    curve = together([Curve(steps, steps / 50, steps / 20, 50.0 * steps, steps)])
    before = {key: value for key, value in curve.items() if key != "return"}
    for name, one in (("with", curve), ("without", before)):
        draw([{"name": "ff-nominal", "curve": one}, {"name": "another", "curve": one}], tmp_path / f"{name}.png")
    assert (tmp_path / "with.png").read_bytes() != (tmp_path / "without.png").read_bytes()
