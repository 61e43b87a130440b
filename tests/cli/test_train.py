"""`vispeg train`: what its options ask for, without training."""

from pathlib import Path

import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from vispeg.cli.learning.play import Film  # noqa: E402
from vispeg.learn.config import Stage, TrainConfig, read_config  # noqa: E402
from vispeg.task.environments.vector import spaces, world_of  # noqa: E402


@pytest.fixture
def asked(vispeg, monkeypatch, tmp_path):
    """Runs the command; gives the configuration it would train by."""
    found = []

    def train(config, folder, show=True):
        found.append(config)
        return folder / "checkpoints" / "best"

    monkeypatch.setattr("vispeg.learn.train.train", train)

    def run(*args):
        code, _, err = vispeg("train", "peg-state", "--films", "0", *args)
        assert code == 0, err
        return found[-1]

    return run


@pytest.fixture
def begun(vispeg, monkeypatch, tmp_path):
    """A folder with a run that can be gone on with, and what is filmed then."""
    filmed = []

    def films(policy, world, settings, seeds, out, overwrite):
        filmed.append((policy, world, settings, len(seeds)))
        out.mkdir()
        yield Film(7, "success", 5.0, "film.mp4")

    monkeypatch.setattr("vispeg.learn.train.resume", lambda folder, steps, show: folder / "checkpoints" / "best")
    monkeypatch.setattr("vispeg.cli.learning.play.films", films)
    (tmp_path / "run").mkdir()
    TrainConfig("peg-state", world="searching", settings={"clearance_mm": 0.5}).write(tmp_path / "run" / "config.yaml")
    return filmed


def clearances(config):
    """Of all stages, what the settings say being the last one's, as the environments are made."""
    return [config.settings.get("clearance_mm") if s.clearance_mm is None else s.clearance_mm for s in config.stages]


def test_shipped_policies_commands_mean_what_they_meant(asked):
    half = asked("--world", "randomized", "--clearance", "0.5", "--curriculum", "3", "1")
    fine = asked("--world", "searching", "--clearance", "0.2", "--curriculum", "3", "1", "0.5")
    assert clearances(half) == [3.0, 1.0, 0.5] and clearances(fine) == [3.0, 1.0, 0.5, 0.2]
    assert [stage.level for stage in half.stages] == [0.5, 1.0, 1.0] and half.ranges == "full"
    assert asked().stages == asked("--clearance", "1").stages == (Stage(),)


def test_a_curriculum_leads_to_the_worlds_own_clearance(asked, tmp_path):
    (tmp_path / "fine.yaml").write_text("format: vispeg-world/1\ntask: {clearance_mm: 0.5, start_radius: 0.03}\n")
    wide = Stage(6.0, level=0.5)
    assert asked("--curriculum", "6").stages == (wide, Stage())
    assert asked("--curriculum", "6", "3").stages == (wide, Stage())  # 3 mm is nominal's own
    assert asked("--world", "fine.yaml", "--curriculum", "6", "1").stages == (wide, Stage(1.0), Stage())
    near = asked("--world", "fine.yaml", "--curriculum", "6", "1", "--start-radius", "0.02").stages
    assert near == (Stage(6.0, 0.02, 0.5), Stage(1.0), Stage())
    assert asked("--start-radius", "0.005", "0.01").stages == (Stage(None, 0.005, 0.5), Stage(None, 0.01), Stage())


def test_stack_directions_and_reward_are_asked_for_and_kept_through_the_runs_file(asked, tmp_path):
    config = asked("--stack", "4", "--dof", "x", "y", "z", "rx", "--reward", "paper", "--clearance", "1")
    config.write(tmp_path / "config.yaml")
    settings = read_config(tmp_path / "config.yaml").settings
    task = world_of(config.world, dict(settings))[1]
    assert (task.stack, task.dof, task.reward) == (4, ("x", "y", "z", "rx"), "paper")
    assert spaces(task, "state", ())[0]["policy"].shape == (4 * (12 + 4 + 6),)
    assert asked().settings == {}


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--curriculum", "6", "3", "1"], ["--curriculum", "widest first", "above the 3 mm"]),
        (["--clearance", "1", "--curriculum", "2", "3"], ["--curriculum", "widest first"]),
        (["--start-radius", "0.01", "0.005"], ["--start-radius", "nearest first", "below the 0.02 m"]),
        (["--ranges", "adaptive", "--world", "searching", "--curriculum", "6"], ["ranges", "a curriculum opens"]),
        (["--stack", "4", "--recurrent", "64"], ["--stack", "a memory and a stack"]),
        (["--dof", "x", "q"], ["dof", "unknown directions", "choices: x, y, z, rx, ry, rz"]),
        (["--stack", "0"], ["stack", "too small"]),
        (["--ranges", "schedule", "--recipe", "distill"], ["ranges", "distillation alone"]),
        (["--ranges", "wide"], ["--ranges", "adaptive"]),
        (["--steps", "0"], ["steps", "at least 1"]),
        (["--films", "-1"], ["--films", "negative"]),
    ],
)
def test_mistakes(refused, args, words):
    refused(["train", "peg-state", *args, "--out", "run"], *words)


def test_a_resumed_run_is_filmed_once(vispeg, begun):
    assert vispeg("train", "--resume", "run", "--films", "0")[0] == 0 and not begun
    code, out, _ = vispeg("train", "--resume", "run", "--steps", "200", "--films", "3")
    film = "seed 7: success, peak force 5 N, film.mp4"
    assert code == 0 and out.splitlines() == ["best policy: run/checkpoints/best", film]
    assert begun == [(Path("run/checkpoints/best"), "searching", {"clearance_mm": 0.5}, 3)]
    assert vispeg("train", "--resume", "run")[0] == 0 and len(begun) == 1


def test_options_of_no_effect_on_a_resumed_run_are_refused(refused, begun):
    args = ["train", "peg-state", "--resume", "run", "--seed", "3", "--start-radius", "0.01", "--steps", "9"]
    refused(args, "--resume", "TASK --start-radius --seed", "--steps and --films alone")
