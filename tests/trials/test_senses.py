"""A sense that simulation has otherwise moves the action; of trials in their own world none does."""

import json
import shutil

import numpy as np
import pytest

from vispeg.api.explain import ASSUMED
from vispeg.api.run import opened
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.evaluation.senses import ARM, PICTURES, places, seen
from vispeg.interface.interface import NoInterface
from vispeg.learn.interface import interface_of_policy
from vispeg.learn.policy import load
from vispeg.learn.shipped import policy_folder
from vispeg.robots.declare import REPEATABILITY
from vispeg.trials.trial import folders, read_trial

LEAST = REPEATABILITY["iiwa14"]  # mm
TRIALS, POLICY = 10, "depth-S-randomized"
HIDDEN = {
    "camera": "{effect: camera_offset, where: wrist_wide, params: {x: 0.02}}",
    "arm": "{effect: coulomb_friction, where: joint4, params: {torque: 6.0}}",
}


@pytest.fixture(scope="module")
def cells(tmp_path_factory):
    """Cells with a hidden effect each, and what a policy that sees depth did in them."""
    place = tmp_path_factory.mktemp("cells")
    for name, effect in HIDDEN.items():
        world = place / f"{name}.yaml"
        world.write_text(f"format: vispeg-world/1\nbase: nominal\neffects:\n  - {effect}\n")
        argv = ["evaluate", POLICY, "--world", str(world), "--episodes", str(TRIALS), "--videos", "0", "--quiet"]
        assert main([*argv, "--json", "--out", str(place / f"{name}-e"), "--keep-trials", str(place / name)]) == 0
    return place


def explained(trials, world, out):
    how = ["explain", str(trials), "--policy", POLICY, "--world", str(world), "--replays", "2", "--quiet", "--json"]
    assert main([*how, "--out", str(out)]) == 0
    found = json.loads((out / "explain.json").read_text())
    return found, {row["sense"]: row for row in found["senses"]}


def test_a_camera_that_sits_elsewhere_is_told_from_an_arm_that_sticks(cells, tmp_path):
    found, by = explained(cells / "camera", "nominal", tmp_path / "camera")
    assert by[PICTURES]["points_to"] and by[PICTURES]["more_mm"]["low"] > LEAST
    m = found["moment"]
    assert m["sense"] == PICTURES and not np.allclose(m["robot_mm"], m["simulated_mm"], atol=1.0)
    page = (tmp_path / "camera" / "explain.html").read_text()
    assert m["trial"] in page and page.count("data:image/png") > 20 and "camera or looks" in page

    found, by = explained(cells / "arm", "nominal", tmp_path / "arm")
    assert by[ARM]["points_to"] and found["senses"][0]["sense"] == ARM
    assert not by[PICTURES]["points_to"] and by[PICTURES]["moved_mm"] < LEAST, "the same places look the same"


@pytest.mark.slow
@pytest.mark.parametrize("name", HIDDEN)
def test_in_their_own_world_no_sense_moves_the_action(cells, tmp_path, name):
    found, by = explained(cells / name, cells / f"{name}.yaml", tmp_path / "own")
    assert all(row["moved_mm"] < LEAST and not row["points_to"] for row in by.values()), by
    assert np.allclose(found["moment"]["robot_mm"], found["moment"]["simulated_mm"], atol=2.0)


def test_the_policy_acts_on_a_kept_trial_as_it_acted_then(cells):
    """What is exchanged stands in what the policy saw: nothing exchanged, the same actions."""
    folder = policy_folder(POLICY)
    policy, meaning = load(folder), interface_of_policy(load(folder))
    for path in folders(cells / "camera")[:3]:
        trial = read_trial(path)
        policy.reset(1)
        for k, pictures in enumerate(seen(trial, meaning)):
            action = policy.act({"policy": trial.steps.seen[[k]].astype(np.float32), **pictures})
            assert np.clip(action[0], -1, 1) == pytest.approx(trial.steps.action[k], abs=0.02), "depth was rounded"
        assert len(places(trial)) == len(trial.steps.time)


@pytest.mark.slow
def test_how_far_an_arm_repeats_decides_what_is_called(cells, tmp_path):
    """An arm that its world says repeats to within a metre points to nothing, and an unknown one is assumed."""
    world = tmp_path / "loose.yaml"
    world.write_text("format: vispeg-world/1\nbase: nominal\nrobot: {repeatability: 1.0}\n")
    found, by = explained(cells / "camera", world, tmp_path / "loose")
    assert not any(row["points_to"] for row in by.values()) and by[PICTURES]["more_mm"]["low"] > LEAST
    assert ASSUMED not in found["notes"]


def test_only_a_policy_that_no_robot_can_be_given_has_no_senses(cells, tmp_path):
    how = ["explain", str(cells / "arm"), "--replays", "2", "--quiet", "--json"]
    assert main([*how, "--policy", "expert", "--out", str(tmp_path / "expert")]) == 0
    notes = json.loads((tmp_path / "expert" / "explain.json").read_text())["notes"]
    assert any(note.startswith("senses are not compared: policy: cannot be run on a robot") for note in notes)
    for name, key, value in (("gone", "world_file", "gone.yaml"), ("broken", "world_hash", None)):
        shutil.copytree(policy_folder(POLICY), tmp_path / name)
        file = tmp_path / name / "policy.json"
        said = json.loads(file.read_text())
        said["meta"] |= {"world": "gone.yaml", key: value} if value else {}
        said["layout"]["vector"] += 0 if value else 1
        file.write_text(json.dumps(said))
    with pytest.raises(NoInterface, match="the world it was trained in"):
        opened(tmp_path / "gone", None, None)
    with pytest.raises(UserError) as error:
        opened(tmp_path / "broken", None, None)
    assert not isinstance(error.value, NoInterface)
