"""A finished run is not trained again, a killed one goes on, and another configuration is refused."""

import sys
from types import SimpleNamespace

import pytest
from evaluation import policy_of
from training import Budget, Variant, configuration, run_folder, trained

from vispeg.core.errors import UserError
from vispeg.learn.config import read_config
from vispeg.learn.policy import load
from vispeg.learn.run_folder import settled

VARIANT, BUDGET = Variant("a", "searching"), Budget(200, 100, 5)


@pytest.fixture
def calls(monkeypatch):
    """What a run's script asks the trainer for, without training."""
    made = []

    def train(config, folder):
        folder.mkdir(parents=True)
        config.write(folder / "config.yaml")
        made.append(("train", config.steps))

    def resume(folder, steps=None):
        made.append(("resume", steps))

    monkeypatch.setitem(sys.modules, "vispeg.learn.train", SimpleNamespace(train=train, resume=resume))
    return made


def stopped_at(folder, steps):
    (folder / "checkpoints" / "last").mkdir(parents=True)
    (folder / "progress.csv").write_text(f"steps,seconds\n{steps},3\n")


def test_new_killed_early_killed_late_finished_extended(tmp_path, calls):
    folder = run_folder(tmp_path, VARIANT, 1)
    assert trained(tmp_path, VARIANT, 1, BUDGET) == folder
    trained(tmp_path, VARIANT, 1, BUDGET)  # nothing to go on from: anew
    assert calls == [("train", 200), ("train", 200)]
    stopped_at(folder, 100)
    trained(tmp_path, VARIANT, 1, BUDGET)
    assert calls[2:] == [("resume", 200)]
    (folder / "progress.csv").write_text("steps,seconds\n100,3\n200,6\n")
    trained(tmp_path, VARIANT, 1, BUDGET)
    assert len(calls) == 3
    trained(tmp_path, VARIANT, 1, Budget(300, 100, 5))
    assert calls[3:] == [("resume", 300)]


@pytest.mark.parametrize("other", [Variant("a", "randomized"), Variant("a", "searching", stack=3)])
def test_another_configuration_under_the_same_name_is_refused(tmp_path, calls, other):
    trained(tmp_path, VARIANT, 1, BUDGET)
    with pytest.raises(UserError, match="trained otherwise"):
        trained(tmp_path, other, 1, BUDGET)
    with pytest.raises(UserError, match="trained otherwise"):
        trained(tmp_path, VARIANT, 1, Budget(100, 100, 5))


def test_an_imitator_s_run_is_known_again_and_goes_on_after_its_last_round(tmp_path, calls):
    """A run's file holds the settings that its recipe chose; its checkpoints are rounds."""
    imitates = Variant("b", "S", modality="depth", teacher="state-3mm")
    folder = run_folder(tmp_path, imitates, 1)
    folder.mkdir(parents=True)
    settled(configuration(imitates, 1, BUDGET)).write(folder / "config.yaml")
    (folder / "rounds").mkdir()
    assert trained(tmp_path, imitates, 1, BUDGET) == folder
    assert calls == [("resume", None)] and (folder / "rounds").is_dir()


def test_recurrent_actors_see_one_observation():
    recurrent = configuration(Variant("a", "searching", stack=4, recurrent=64), 1, BUDGET)
    assert recurrent.settings["stack"] == 1 and recurrent.sac.recurrent == 64
    assert configuration(Variant("a", "searching", stack=4), 1, BUDGET).settings["stack"] == 4


def test_a_run_that_never_came_to_its_last_stage_is_judged_by_its_last_policy(tmp_path):
    (tmp_path / "last").mkdir()
    assert policy_of(tmp_path) == tmp_path / "last"
    (tmp_path / "best").mkdir()
    assert policy_of(tmp_path) == tmp_path / "best"


def test_a_run_goes_on_in_another_world_from_half_the_steps_in_the_first(tmp_path):
    """The first half is the other run's; what was best there does not count in the second world."""
    begun, budget = Variant("a", "searching"), Budget(416, 208, 4)
    folder = trained(tmp_path, Variant("b", "nominal", begun=begun), 1, budget)
    first = (run_folder(tmp_path, begun, 1) / "progress.csv").read_text().splitlines()
    both = (folder / "progress.csv").read_text().splitlines()
    assert both[: len(first)] == first and [int(line.split(",")[0]) for line in both[1:]] == [208, 416]
    assert read_config(folder / "config.yaml") == settled(configuration(Variant("b", "nominal"), 1, budget))
    assert load(policy_of(folder / "checkpoints")).meta["world"] == "nominal"
    trained(tmp_path, Variant("b", "nominal", begun=begun), 1, budget)
    assert (folder / "progress.csv").read_text().splitlines() == both
