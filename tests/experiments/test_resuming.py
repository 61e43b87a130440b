"""A finished run is not trained again, a killed one goes on, and another configuration is refused."""

import csv
import shutil

import pytest
from evaluation import policy_of
from training import Budget, Variant, configuration, run_folder, trained

from vispeg.core.errors import UserError
from vispeg.learn.config import read_config
from vispeg.learn.policy import load
from vispeg.learn.run_folder import settled

VARIANT, BUDGET = Variant("a", "searching"), Budget(32, 16, 1)


def curve(folder):
    """What a run's evaluations say, without the seconds that they took."""
    with (folder / "progress.csv").open() as stream:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(stream)]


def test_new_killed_early_killed_late_finished_extended(tmp_path):
    folder = run_folder(tmp_path, VARIANT, 1)
    half, whole = (settled(configuration(VARIANT, 1, b)) for b in (Budget(16, 16, 1), BUDGET))
    trained(tmp_path, VARIANT, 1, Budget(16, 16, 1))
    assert read_config(folder / "config.yaml") == half and len(curve(folder)) == 1
    whole.write(folder / "config.yaml")  # as of a run of 32 steps that was killed after 16
    assert trained(tmp_path, VARIANT, 1, BUDGET) == folder
    late = curve(folder)
    assert [row["steps"] for row in late] == ["16", "32"]
    shutil.rmtree(folder / "checkpoints" / "last")  # nothing to go on from: anew
    trained(tmp_path, VARIANT, 1, BUDGET)
    assert curve(folder) == late and (folder / "checkpoints" / "last").is_dir()
    before = (folder / "progress.csv").read_bytes()
    trained(tmp_path, VARIANT, 1, BUDGET)
    assert (folder / "progress.csv").read_bytes() == before, "it is finished"
    trained(tmp_path, VARIANT, 1, Budget(48, 16, 1))
    assert curve(folder)[:2] == late and len(curve(folder)) == 3
    assert (folder / "progress.csv").read_bytes().startswith(before)


@pytest.mark.parametrize("other", [Variant("a", "randomized"), Variant("a", "searching", stack=3)])
def test_another_configuration_under_the_same_name_is_refused(tmp_path, other):
    trained(tmp_path, VARIANT, 1, BUDGET)
    with pytest.raises(UserError, match="trained otherwise"):
        trained(tmp_path, other, 1, BUDGET)
    with pytest.raises(UserError, match="trained otherwise"):
        trained(tmp_path, VARIANT, 1, Budget(100, 100, 5))


def test_an_imitator_s_run_is_known_again_and_goes_on_after_its_last_round(tmp_path):
    """A run's file holds the settings that its recipe chose; its checkpoints are rounds."""
    imitates, budget = Variant("b", "S", modality="state", teacher="state-3mm"), Budget(160, 32, 1)
    folder = run_folder(tmp_path, imitates, 1)
    folder.mkdir(parents=True)
    settled(configuration(imitates, 1, budget)).write(folder / "config.yaml")
    (folder / "rounds").mkdir()  # killed in its first round
    assert trained(tmp_path, imitates, 1, budget) == folder
    assert [row["stage"] for row in curve(folder)] == [f"distill {k}" for k in range(5)]
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    trained(tmp_path, imitates, 1, budget)
    assert {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before


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


def test_a_run_that_is_good_enough_ends_early_and_is_finished(tmp_path):
    """A success of 0 is always reached: two evaluations end a run; in another world it counts anew."""
    budget = Budget(208 * 4, 208, 2, until=0.0)
    folder = trained(tmp_path, VARIANT, 1, budget)
    assert [row["steps"] for row in curve(folder)] == ["208", "416"]
    before = (folder / "progress.csv").read_bytes()
    assert trained(tmp_path, VARIANT, 1, budget) == folder and (folder / "progress.csv").read_bytes() == before
    other = trained(tmp_path, Variant("b", "nominal", begun=Variant("c", "searching")), 1, budget)
    assert [row["steps"] for row in curve(other)] == ["208", "416", "624", "832"]
