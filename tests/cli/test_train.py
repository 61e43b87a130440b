"""`vispeg train`: what its options ask for, without training."""

from pathlib import Path

import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")

from vispeg.api.films import Film
from vispeg.api.train import resume, train
from vispeg.learn.config import Stage, TrainConfig, read_config
from vispeg.task.environments.vector import spaces, world_of


@pytest.fixture
def configs(monkeypatch):
    """What would be trained by, in order; nothing is."""
    found = []

    def begin(config, folder, show=True, overwrite=False):
        found.append(config)
        return folder / "checkpoints" / "best"

    monkeypatch.setattr("vispeg.learn.train.train", begin)
    return found


@pytest.fixture
def asked(vispeg, configs, tmp_path):
    """Runs the command; gives the configuration it would train by."""

    def run(*args):
        code, _, err = vispeg("train", "peg-state", "--films", "0", *args)
        assert code == 0, err
        return configs[-1]

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
    monkeypatch.setattr("vispeg.api.films.films", films)
    (tmp_path / "run").mkdir()
    TrainConfig("peg-state", world="searching", settings={"clearance_mm": 0.5}).write(tmp_path / "run" / "config.yaml")
    return filmed


def clearances(config):
    """Of all stages, what the settings say being the last one's, as the environments are made."""
    return [s.settings.get("clearance_mm", config.settings.get("clearance_mm")) for s in config.stages]


def width(mm):
    return {"clearance_mm": mm}


def test_shipped_policies_commands_mean_what_they_meant(asked):
    half = asked("--world", "randomized", "--clearance", "0.5", "--curriculum", "3", "1")
    fine = asked("--world", "searching", "--clearance", "0.2", "--curriculum", "3", "1", "0.5")
    assert clearances(half) == [3.0, 1.0, 0.5] and clearances(fine) == [3.0, 1.0, 0.5, 0.2]
    assert [stage.level for stage in half.stages] == [0.5, 1.0, 1.0] and half.ranges == "full"
    assert asked().stages == asked("--clearance", "1").stages == (Stage(),)


def test_a_curriculum_leads_to_the_worlds_own_clearance(asked, tmp_path):
    (tmp_path / "fine.yaml").write_text("format: vispeg-world/1\ntask: {clearance_mm: 0.5, start_radius: 0.03}\n")
    wide = Stage(width(6.0), level=0.5)
    assert asked("--curriculum", "6").stages == (wide, Stage())
    assert asked("--curriculum", "6", "3").stages == (wide, Stage())  # 3 mm is nominal's own
    assert asked("--world", "fine.yaml", "--curriculum", "6", "1").stages == (wide, Stage(width(1.0)), Stage())
    near = asked("--world", "fine.yaml", "--curriculum", "6", "1", "--start-radius", "0.02").stages
    assert near == (Stage(width(6.0), 0.02, 0.5), Stage(width(1.0)), Stage())
    assert asked("--start-radius", "0.005", "0.01").stages == (Stage({}, 0.005, 0.5), Stage({}, 0.01), Stage())


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
        (["--stack", "4", "--recurrent", "64"], ["--stack", "an LSTM and stacked observations"]),
        (["--dof", "x", "q"], ["dof", "unknown directions", "choices: x, y, z, rx, ry, rz"]),
        (["--stack", "0"], ["stack", "too small"]),
        (["--ranges", "schedule", "--recipe", "distill"], ["ranges", "distillation alone"]),
        (["--ranges", "wide"], ["--ranges", "adaptive"]),
        (["--recipe", "distill", "--steps", "9"], ["--steps: imitation alone goes by rounds", "--distill-steps"]),
        (["--steps", "0"], ["steps", "at least 1"]),
        (["--films", "-1"], ["--films", "out of range"]),
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


ROUNDS = {"steps": 8, "updates": 4, "looks": 2}


@pytest.mark.parametrize(
    ("flags", "options"),
    [
        ([], {}),
        (
            ["--world", "randomized", "--clearance", "0.5", "--curriculum", "3", "1", "--steps", "640", "--utd", "0.5"],
            {
                "world": "randomized",
                "settings": {"clearance_mm": 0.5},
                "curriculum": (3.0, 1.0),
                "steps": 640,
                "utd": 0.5,
            },
        ),
        (
            ["--recipe", "distill", "--teacher", "expert", "--seed", "7", "--envs", "4", "--dof", "x", "y", "z", "rz"]
            + ["--distill-steps", "8", "--distill-updates", "4", "--distill-looks", "2"],
            {
                "recipe": "distill",
                "teacher": "expert",
                "seed": 7,
                "envs": 4,
                "settings": {"dof": ("x", "y", "z", "rz")},
                "distill": ROUNDS,
            },
        ),
    ],
)
def test_the_command_and_its_function_ask_for_the_same_run(asked, configs, tmp_path, flags, options):
    config = asked(*flags)
    run = train("peg-state", **options, out=tmp_path / "run")
    assert len(configs) == 2 and configs[1] == config and run.settings == config.settings
    assert run.record == {"run": str(tmp_path / "run"), "best": str(tmp_path / "run" / "checkpoints" / "best")}


def test_a_run_says_how_it_stands(begun, tmp_path):
    assert not resume(tmp_path / "run").history
    head = "steps,seconds,updates,stage,success,reward,peak_force,episode_steps,failures"
    rows = "3200,5,1,0,0.4,1,9,30,\n6400,9,2,0,0.94,1,8,25,timeout 3"
    (tmp_path / "run" / "progress.csv").write_text(f"{head}\n{rows}\n")
    run = resume(tmp_path / "run")
    assert [float(row["success"]) for row in run.history] == [0.4, 0.94] and run.world == "searching"
    assert "94%" in run._repr_html_() and run.settings == {"clearance_mm": 0.5}


def test_an_engine_is_for_the_imitation_of_a_teacher(refused):
    imitation = ("imitation of a teacher", "the recipe distill")
    refused(("train", "peg-state", "--engine", "warp", "--out", "run"), "engine", *imitation, "got 'sac'")
    beside = ("--recipe", "distill", "--dataset", "demos")
    refused(("train", "peg-depth", "--engine", "warp", "--out", "run", *beside), *imitation, "got 'a dataset'")


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_an_expert_is_imitated_on_the_other_engine(vispeg, tmp_path):
    """In pictures too, which show the state of the rows; evaluations are on MuJoCo itself."""
    pytest.importorskip("mujoco_warp")
    small = "--envs 3 --distill-steps 12 --distill-updates 2 --episodes 2 --films 0 --quiet --recipe distill".split()
    for task in ("peg-state", "peg-depth"):
        code, _, err = vispeg("train", task, "--engine", "warp", "--teacher", "expert", "--out", task, *small)
        assert code == 0, err
        assert read_config(tmp_path / task / "config.yaml").engine == "warp"
        assert (tmp_path / task / "checkpoints" / "best" / "policy.json").exists()
