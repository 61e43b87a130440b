"""A killed run goes on with the same curve; imitation comes near its teacher; configurations are checked."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from toy import STEP, Pointing, Reach

from vispeg.core.errors import UserError
from vispeg.learn.config import Stage, TrainConfig, read_config
from vispeg.learn.evaluation import run_episodes, success_rate
from vispeg.learn.methods.curriculum import Curriculum, stages
from vispeg.learn.methods.distill import collect, demonstrations
from vispeg.learn.methods.ranges import Opening
from vispeg.learn.methods.recipes import distilled
from vispeg.learn.methods.sac_run import SacRun
from vispeg.learn.policy import load
from vispeg.learn.run_folder import same_run
from vispeg.learn.sb3_env import Sb3Env
from vispeg.learn.settings import SacSettings
from vispeg.learn.train import resume, train
from vispeg.task.peg.config import PegConfig
from vispeg.worlds.distribution import Uniform
from vispeg.worlds.randomized import RandomizedEffect, RandomizedWorld

ROOT = Path(__file__).resolve().parents[2]
SAC = SacSettings(batch=32, hidden=(16, 16), warmup=80, replay=600, horizon=12, utd=0.25)


def config(mode="state", **changes):
    base = dict(task=f"peg-{mode}", steps=480, every=160, episodes=8, envs=8, sac=SAC)
    return TrainConfig(**(base | changes))


def make(mode):
    return lambda rows, settings: Reach(rows, mode)


def curve(folder):
    with (folder / "progress.csv").open() as stream:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(stream)]


@pytest.mark.parametrize(
    ("mode", "sac"), [("state", {}), ("depth", {}), ("state", {"recurrent": 8}), ("depth", {"symmetric": True})]
)
def test_a_killed_run_goes_on_with_the_same_curve(tmp_path, mode, sac):
    c = config(mode, sac=replace(SAC, **sac))
    train(c, tmp_path / "whole", make(mode), show=False)
    train(replace(c, steps=160), tmp_path / "part", make(mode), show=False)
    torch.manual_seed(99)  # whatever happened in between
    resume(tmp_path / "part", 480, make(mode), show=False)
    assert curve(tmp_path / "part") == curve(tmp_path / "whole")
    weights = [(tmp_path / name / "checkpoints/last/state.safetensors").read_bytes() for name in ("whole", "part")]
    assert weights[0] == weights[1]


def test_networks_have_the_threads_that_the_run_was_given_and_keep_them_when_it_goes_on(tmp_path):
    before, seen = torch.get_num_threads(), []

    def made(rows, settings):
        seen.append(torch.get_num_threads())
        return Reach(rows, "state")

    try:
        train(config(threads=2, steps=160), tmp_path / "run", made, show=False)
        torch.set_num_threads(1)
        resume(tmp_path / "run", 320, made, show=False)
    finally:
        torch.set_num_threads(before)
    assert set(seen) == {2}


def test_a_resumed_run_tells_the_command_that_made_it_and_clears_its_rounds(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["vispeg", "train", "reach", "--seed", "7"])
    train(config(steps=160), tmp_path / "run", make("state"), show=False)
    (tmp_path / "run/rounds").mkdir()  # as a distillation leaves it whose reinforcement was killed
    for steps in (320, 480):
        monkeypatch.setattr("sys.argv", ["vispeg", "train", "--resume", "run"])
        resume(tmp_path / "run", steps, make("state"), show=False)
        told = json.loads((tmp_path / "run/checkpoints/last/policy.json").read_text())
        assert told["meta"]["command"] == "vispeg train reach --seed 7"
    assert not (tmp_path / "run/rounds").exists()


@pytest.mark.parametrize(
    ("target", "steps", "said"), [(0.0, 640, "ended at its target"), (2.0, 160, "has more steps; expected >= 320")]
)
def test_steps_that_a_run_would_not_train_on_to_are_refused(tmp_path, target, steps, said):
    """It ended at its target after two of three evaluations, or has more of them."""
    train(config(target=target, steps=480 if target == 0 else 320), tmp_path / "run", make("state"), show=False)
    files = {p: p.read_bytes() for p in (tmp_path / "run").rglob("*") if p.is_file()}
    assert [row["steps"] for row in curve(tmp_path / "run")] == ["160", "320"]
    with pytest.raises(UserError, match=said):
        resume(tmp_path / "run", steps, make("state"), show=False)
    assert {p: p.read_bytes() for p in (tmp_path / "run").rglob("*") if p.is_file()} == files


def test_stages_follow_success_and_are_remembered(tmp_path):
    c = config(stages=(Stage(level=0.1), Stage(level=1.0)), pass_rate=0.5, steps=160)
    train(c, tmp_path / "run", make("state"), show=False)  # at level 0.1 every start is at the target
    assert [row["stage"] for row in curve(tmp_path / "run")] == ["0"]
    assert not (tmp_path / "run/checkpoints/best").exists()  # only what is trained for can be the best
    assert load(tmp_path / "run/checkpoints/steps-160").meta["steps"] == 160  # but every evaluation's is kept
    resume(tmp_path / "run", 320, make("state"), show=False)
    assert [row["stage"] for row in curve(tmp_path / "run")] == ["0", "1"]


def test_imitation_in_an_easy_stage_is_not_the_best(tmp_path):
    distill = {"steps": 80, "updates": 5, "betas": (1.0, 0.0)}
    course = (Stage(level=0.1), Stage(level=1.0))
    c = config("depth", recipe="distill+sac", stages=course, pass_rate=0.5, steps=160, distill=distill)
    distilled(c, tmp_path / "run", make("depth"), False, Pointing())
    assert [row["success"] for row in curve(tmp_path / "run")] == ["1"] * 3  # all starts are at the target
    kept = {p.name for p in (tmp_path / "run" / "checkpoints").iterdir()}
    assert kept == {"updates-5", "updates-10", "steps-160", "last"}


def test_a_run_stops_once_its_target_was_reached_twice(tmp_path):
    c = config(stages=(Stage(level=0.1),), target=0.5, steps=2000)
    train(c, tmp_path / "run", make("state"), show=False)
    assert len(curve(tmp_path / "run")) == 2


@pytest.mark.slow
def test_a_student_comes_near_its_teacher_and_the_run_can_go_on(tmp_path):
    sac = SacSettings(batch=32, hidden=(32, 32), actor_frozen=10, utd=0.25, clone_updates=10)
    c = config(
        "depth",
        recipe="distill+sac",
        sac=sac,
        steps=160,
        distill={"steps": 240, "updates": 200, "betas": (1.0, 0.5, 0.0)},
    )
    folder = tmp_path / "run"
    distilled(c, folder, make("depth"), False, Pointing())
    student = load(folder / "checkpoints/best")
    assert success_rate(run_episodes(student, Reach(16, "depth"), range(900, 932))) > 0.9
    rows = curve(folder)
    assert [row["stage"] for row in rows] == ["distill 0", "distill 1", "distill 2", "0"]
    assert [row["steps"] for row in rows] == ["240", "480", "720", "160"]
    kept = {p.name for p in (folder / "checkpoints").iterdir()} - {"best", "last"}
    assert kept == {"updates-200", "updates-400", "updates-600", "steps-160"}, "every evaluation's, at any steps"
    resume(folder, 320, make("depth"), show=False)
    assert len(curve(folder)) == 5


def test_reinforcement_has_no_demonstrations_from_a_round_in_which_the_student_acts(tmp_path):
    """Its transitions hold the teacher's actions: they are those that led on only where the teacher alone acts."""

    class Away(Pointing):
        def act(self, obs):
            return -super().act(obs)

    for beta in (1.0, 0.3):
        ring = collect(Sb3Env(Reach(4)), Pointing(), Away(), beta, 80, 0.0, seed=0)
        batch = ring._batch(*np.nonzero(ring.starts))
        here, there = (obs["privileged"][:, :2].numpy() for obs in (batch.obs, batch.next_obs))
        led = np.clip(here - STEP * batch.action.numpy()[:, :2], -1, 1)
        assert np.allclose(led, there, atol=1e-5) == (beta == 1)
    c = config("depth", recipe="distill+sac", distill={"betas": (0.3, 0.0)})
    with pytest.raises(UserError, match="distill.betas: reinforcement draws from the first round.*expected 1 first"):
        distilled(c, tmp_path / "run", make("depth"), False, Pointing())
    assert not (tmp_path / "run").exists()


def test_runs_of_neighbouring_seeds_share_no_starts_in_any_round(tmp_path):
    from vispeg.learn.methods.distill import distill
    from vispeg.learn.methods.recipes import distill_settings

    settings, starts = distill_settings({"steps": 4, "updates": 1, "betas": (1.0, 1.0, 1.0)}), []
    for seed in range(3):
        model = SacRun(config(seed=seed), tmp_path, make("state"), show=False).model
        rings = distill(model.actor, "state", model.env, Pointing(), settings, seed)
        starts += [tuple(np.ravel(ring.obs["policy"][0])) for ring in rings]
    assert len(set(starts)) == len(starts) == 9


def test_a_killed_distillation_goes_on_after_its_last_round(tmp_path):
    class Killed(Pointing):
        """Dies in the second round."""

        steps = 0

        def act(self, obs):
            self.steps += 1
            if self.steps > 30:
                raise KeyboardInterrupt
            return super().act(obs)

    c = config("depth", recipe="distill", distill={"steps": 160, "updates": 20, "betas": (1.0, 0.5, 0.0)})
    distilled(c, tmp_path / "whole", make("depth"), False, Pointing())
    with pytest.raises(KeyboardInterrupt):
        distilled(c, tmp_path / "part", make("depth"), False, Killed())
    assert len(curve(tmp_path / "part")) == 1
    first = {p: p.read_bytes() for p in (tmp_path / "part/tensorboard").rglob("*") if p.is_file()}
    torch.manual_seed(99)  # whatever happened in between
    distilled(c, tmp_path / "part", make("depth"), False, Pointing())
    assert curve(tmp_path / "part") == curve(tmp_path / "whole")
    weights = [(tmp_path / name / "checkpoints/best/policy.safetensors").read_bytes() for name in ("whole", "part")]
    assert weights[0] == weights[1]
    assert not (tmp_path / "part/rounds").exists(), "they are large"
    assert first and all(p.read_bytes() == was for p, was in first.items()), "curves of the first round stay"
    files = {p: p.read_bytes() for p in (tmp_path / "part").rglob("*") if p.is_file()}
    best = resume(tmp_path / "part", make=make("depth"), show=False)  # there is nothing left to do
    assert best == tmp_path / "part/checkpoints/best"
    with pytest.raises(UserError, match="steps: imitation goes by rounds; expected a new run.*got 320"):
        resume(tmp_path / "part", 320, make("depth"), show=False)
    assert {p: p.read_bytes() for p in (tmp_path / "part").rglob("*") if p.is_file()} == files


def test_a_distillation_stops_once_its_target_was_reached_twice_and_stays_stopped(tmp_path, monkeypatch):
    def killed(folder, **_):
        raise KeyboardInterrupt

    betas = {"steps": 160, "updates": 20, "betas": (1.0, 0.5, 0.0, 0.0)}
    c = config("depth", recipe="distill", target=0.0, distill=betas)
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr("vispeg.learn.methods.recipes.shutil.rmtree", killed)
        distilled(c, tmp_path / "run", make("depth"), False, Pointing())
    assert len(curve(tmp_path / "run")) == 2
    distilled(c, tmp_path / "run", make("depth"), False, Pointing())
    assert len(curve(tmp_path / "run")) == 2 and not (tmp_path / "run/rounds").exists()
    never = config("depth", recipe="distill", target=2.0, distill=betas)
    distilled(never, tmp_path / "never", make("depth"), False, Pointing())
    assert len(curve(tmp_path / "never")) == 4


def test_labels_are_the_teachers_whoever_acts():
    env = Sb3Env(Reach(4))
    ring = collect(env, Pointing(), None, 1.0, 80, 0.3, seed=0)
    at, row = np.nonzero(ring.starts)
    batch = ring._batch(at, row)
    offset = batch.obs["privileged"][:, :2].numpy()
    assert np.allclose(batch.action.numpy()[:, :2], np.clip(offset / STEP, -1, 1), atol=1e-6)


def test_demonstrations_are_successes_only_and_as_many_as_asked():
    class Sometimes(Pointing):
        def act(self, obs):
            aside = obs["privileged"][:, :1] > 0  # on one side it stays where it is, and fails
            return np.where(aside & (obs["privileged"][:, 2:] == 0), 0, super().act(obs)) * ~aside

    ring, tried = demonstrations(Sb3Env(Reach(4)), Sometimes(), 10, seed=0)
    assert int(ring.done.sum()) >= 10 and tried > 10
    first = ring.starts & ~np.roll(ring.starts, 1, axis=0)
    at, row = np.nonzero(ring.starts)
    batch = ring._batch(at, row)
    assert int(batch.done.sum()) == 10 and first.sum() <= 10
    assert (batch.done.sum() == 10) and bool((batch.reward[batch.done > 0] > 0.5).all())

    class Never(Pointing):
        def act(self, obs):
            return 0 * super().act(obs)

    with pytest.raises(UserError, match="does not succeed"):
        demonstrations(Sb3Env(Reach(4)), Never(), 20, seed=0)


def test_demonstrations_of_long_episodes_are_kept_whole(monkeypatch):
    monkeypatch.setattr("toy.HORIZON", 1000)

    class Late(Pointing):
        def act(self, obs):
            return super().act(obs) * (obs["privileged"][:, 2:] > 0.9)

    ring, tried = demonstrations(Sb3Env(Reach(4)), Late(), 1, seed=0)
    assert tried >= 1 and len(ring) > 900 and ring.sequences(2, 5).weight.all()


def test_configuration_survives_its_file(tmp_path):
    course = stages((6.0, 4.5), (0.005,), PegConfig())
    c = config(stages=course, settings={"clearance_mm": 3.0}, distill={"betas": [1.0, 0.0]})
    for given in (c, config(ranges="adaptive")):
        given.write(tmp_path / "config.yaml")
        assert read_config(tmp_path / "config.yaml") == given


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"recipe": "magic"}, "no such recipe"),
        ({"task": "poke"}, "no such task"),
        ({"steps": 0}, "at least 1"),
        ({"stages": ()}, "needs a stage"),
        ({"ranges": "wide"}, "ranges: no such way to open the ranges.*choices: full, schedule, adaptive"),
        ({"ranges": "adaptive", "recipe": "distill"}, "distillation alone opens no ranges"),
        ({"ranges": "schedule", "stages": stages((6.0,), (), PegConfig())}, "a curriculum opens the ranges itself"),
        ({"recipe": "distill", "stages": stages((6.0,), (), PegConfig())}, "distillation alone has no stages"),
        ({"sac": {"gamma": 2.0}}, "between 0 and 1"),
        ({"sac": {"lr": -1.0}}, "positive"),
    ],
)
def test_a_run_that_cannot_be_is_refused(change, said):
    with pytest.raises(UserError, match=said):
        if "sac" in change:
            SacSettings(**change["sac"])
        else:
            config(**change)


@pytest.mark.parametrize("level", [-1.0, 5.0])
def test_a_level_is_a_share_of_the_ranges(level):
    with pytest.raises(UserError, match="level: not a share"):
        Stage(level=level)


def test_a_run_is_replaced_on_request_alone_and_is_there_again_if_the_new_one_never_begins(tmp_path):
    """Of any configuration, its own included; a file of somebody else's in it, or an input, keeps it in its place."""
    run, other = tmp_path / "run", {"show": False, "overwrite": True}
    train(config(steps=320), run, make("state"), **other)
    first = {p.relative_to(run): p.read_bytes() for p in run.rglob("*") if p.is_file()}

    def broken(*args, **kwargs):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(config(steps=320, seed=1), run, broken, **other)
    assert {p.relative_to(run): p.read_bytes() for p in run.rglob("*") if p.is_file()} == first
    with pytest.raises(UserError, match="which this command reads"):
        teacher = str(run / "checkpoints" / "best")
        train(config(recipe="distill", teacher=teacher, distill={}), run, make("state"), **other)
    (run / "thesis.tex").write_text("years")
    with pytest.raises(UserError, match="not a folder of such results .it holds thesis.tex"):
        train(config(steps=320, seed=1), run, make("state"), **other)
    (run / "thesis.tex").unlink()
    train(config(steps=320, seed=1), run, make("state"), **other)
    again = read_config(run / "config.yaml")
    assert again.seed == 1 and (run / "progress.csv").read_bytes() != first[Path("progress.csv")]
    train(config(steps=320), run, make("state"), **other)
    assert curve(run) and read_config(run / "config.yaml").seed == 0
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


@pytest.mark.parametrize("command", ["train", "resume"])
@pytest.mark.parametrize("at", ["its beginning", "its first evaluation"])
def test_a_run_put_aside_by_one_that_was_killed_is_there_again_for_any_other(tmp_path, monkeypatch, command, at):
    """The old run is kept until the new one has a checkpoint."""
    run = tmp_path / "run"
    train(config(steps=320), run, make("state"), show=False)
    first = {p.relative_to(run): p.read_bytes() for p in run.rglob("*") if p.is_file()}

    def killed(*args, **kwargs):
        os.kill(os.getpid(), signal.SIGKILL)

    if (child := os.fork()) == 0:
        if at == "its beginning":
            train(config(steps=320), run, killed, show=False, overwrite=True)
        monkeypatch.setattr("vispeg.learn.train.SacRun.evaluate", killed)
        train(config(steps=320, seed=2), run, make("state"), show=False, overwrite=True)
    os.waitpid(child, 0)
    assert run.exists() == (at == "its first evaluation")
    if command == "resume":
        assert resume(run, make=make("state"), show=False).is_dir()
        assert (run / "progress.csv").read_bytes() == first[Path("progress.csv")]
    else:
        with pytest.raises(UserError, match="exists already"):
            train(config(steps=320, seed=1), run, make("state"), show=False)
        assert {p.relative_to(run): p.read_bytes() for p in run.rglob("*") if p.is_file()} == first
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_runs_are_not_overwritten_and_strangers_not_resumed(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "mine.txt").write_text("x")
    with pytest.raises(UserError, match="exists already"):
        train(config(), tmp_path / "run", make("state"), show=False)
    with pytest.raises(UserError, match="not a training run"):
        resume(tmp_path / "run")
    train(config(steps=320), tmp_path / "other", make("state"), show=False)
    with pytest.raises(UserError, match="exists already"):
        train(config(steps=320, seed=1), tmp_path / "other", make("state"), show=False)
    for file in filter(Path.is_file, (tmp_path / "other/checkpoints/last").iterdir()):
        file.write_bytes(file.read_bytes()[:40])
    before = {p: p.read_bytes() for p in (tmp_path / "other").rglob("*") if p.is_file()}
    with pytest.raises(UserError):
        resume(tmp_path / "other", 480, make("state"), show=False)
    assert {p: p.read_bytes() for p in (tmp_path / "other").rglob("*") if p.is_file()} == before
    shutil.rmtree(tmp_path / "other/checkpoints/last")
    with pytest.raises(UserError, match="no checkpoint"):
        resume(tmp_path / "other", 480, make("state"), show=False)


@pytest.mark.parametrize("again", ["the same", "--resume"])
@pytest.mark.parametrize("recipe", ["sac", "distill"])
def test_a_run_killed_before_its_first_checkpoint_is_no_dead_end(tmp_path, monkeypatch, recipe, again):
    def killed(*_, **__):
        raise KeyboardInterrupt

    more = {} if recipe == "sac" else {"recipe": recipe, "teacher": "x", "distill": {"steps": 80, "updates": 10}}
    c, weights = config(steps=160, **more), []
    monkeypatch.setattr("vispeg.learn.methods.recipes.teacher_of", lambda *_: Pointing())
    monkeypatch.setattr(Reach, "config", None, raising=False)
    train(c, tmp_path / "whole", make("state"), show=False)
    for number, at in enumerate(("vispeg.learn.train.SacRun.evaluate", "vispeg.learn.train.SacRun.keep")):
        run = tmp_path / f"run-{number}"
        monkeypatch.setattr("sys.argv", ["vispeg", "train", "reach"])
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(at, killed)
            train(c, run, make("state"), show=False)
        torch.manual_seed(99)
        monkeypatch.setattr("sys.argv", ["vispeg", "train", "--resume", "run"])
        if again == "--resume":
            resume(run, make=make("state"), show=False)
        else:
            train(c, run, make("state"), show=False)
        assert curve(run) == curve(tmp_path / "whole")
        assert json.loads((run / "checkpoints/best/policy.json").read_text())["meta"]["command"] == "vispeg train reach"
        weights.append((run / "checkpoints/best/policy.safetensors").read_bytes())
    assert {*weights} == {(tmp_path / "whole/checkpoints/best/policy.safetensors").read_bytes()}


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[3])
import torch
torch.manual_seed(7)
from test_train import config, make
from vispeg.learn import train
from vispeg.learn.methods.sac import AsymmetricSAC
update, updates = AsymmetricSAC._update_critic, []

def counted(self, batch):
    updates.append(1)
    if len(updates) == int(sys.argv[2]):
        os.kill(os.getpid(), signal.SIGKILL)
    return update(self, batch)

AsymmetricSAC._update_critic = counted
train.train(config(), Path(sys.argv[1]), make("state"), show=False)
"""


@pytest.mark.slow
def test_a_run_killed_while_it_learns_goes_on_to_the_same_bits(tmp_path):
    train(config(), tmp_path / "whole", make("state"), show=False)
    updates = [int(row["updates"]) for row in curve(tmp_path / "whole")]
    assert updates[0] > 10, "it learns before its first checkpoint"
    command = [sys.executable, "-c", KILLED, str(tmp_path / "run")]
    for at in (updates[0] + 5, 3):  # updates after its first checkpoint, and just after going on from there
        done = subprocess.run([*command, str(at), str(Path(__file__).parent)], cwd=ROOT, timeout=100)
        assert done.returncode == -signal.SIGKILL
        assert (tmp_path / "run/checkpoints/last").is_dir()
    resume(tmp_path / "run", make=make("state"), show=False)
    assert curve(tmp_path / "run") == curve(tmp_path / "whole")
    weights = [(tmp_path / name / "checkpoints/last/state.safetensors").read_bytes() for name in ("whole", "run")]
    assert weights[0] == weights[1]


def test_a_curriculum_moves_on_only_by_success():
    course = Curriculum(stages((6.0, 3.0), (0.01,), PegConfig(clearance_mm=1.0)), 0.8)
    assert course.settings({"stack": 3, "clearance_mm": 1.0}) == {"stack": 3, "clearance_mm": 6.0, "start_radius": 0.01}
    assert [course.after(s) for s in (0.7, 0.8, 0.79, 1.0, 1.0)] == [False, True, False, True, False]
    assert course.last and course.settings({"stack": 3}) == {"stack": 3}


@pytest.mark.parametrize(
    ("wide", "near", "made"),
    [
        ((), (), []),
        ((3.0, 1.0), (), [(3.0, None), (1.0, None)]),
        ((3.0, 1.0, 0.5), (), [(3.0, None), (1.0, None)]),  # 0.5 mm is what is trained for anyway
        ((3.0, 1.0), (0.005,), [(3.0, 0.005), (1.0, None)]),
        ((3.0,), (0.005, 0.01, 0.02), [(3.0, 0.005), (None, 0.01)]),
        ((), (0.005, 0.01), [(None, 0.005), (None, 0.01)]),
    ],
)
def test_stages_lead_to_the_task_as_it_is(wide, near, made):
    *first, last = stages(wide, near, PegConfig(clearance_mm=0.5))
    assert [(stage.settings.get("clearance_mm"), stage.radius) for stage in first] == made and last == Stage()
    assert [stage.level for stage in first] == [0.5, 1.0, 1.0][: len(made)]


@pytest.mark.parametrize(
    ("wide", "near", "said"),
    [
        ((6.0, 3.0, 1.0), (), "curriculum: .*widest first, above the 3 mm"),
        ((4.0, 6.0), (), "widest first"),
        ((6.0, 6.0), (), "widest first"),
        ((float("nan"),), (), "widest first"),
        ((), (0.01, 0.005), "start_radius: .*nearest first, below the 0.02 m"),
        ((), (0.03,), "nearest first"),
        ((), (0.0,), "above 0"),
    ],
)
def test_stages_that_do_not_become_harder_are_refused(wide, near, said):
    with pytest.raises(UserError, match=said):
        stages(wide, near, PegConfig())


class Drawn(Reach):
    """The toy in a world: an episode states its draw, starts as far away as that says, and counts as a success."""

    ranges = (RandomizedEffect("contact_friction", "peg", {"scale": Uniform(0.5, 1.5)}),)
    killed_at = None  # steps after which it dies

    def __init__(self, rows):
        super().__init__(rows)
        self.level, self.began, self.steps = 1.0, [1.0] * rows, 0

    def set_level(self, level):
        super().set_level(level["contact_friction(peg)"] if isinstance(level, dict) else level)

    def reset(self, *, seed=None, options=None):
        rows = np.ones(self.num_envs, bool) if options is None else options["reset_mask"]
        self.began = [self.level if new else was for new, was in zip(rows, self.began, strict=True)]
        return super().reset(seed=seed, options=options)

    def step(self, actions):
        self.steps += 1
        if self.steps == self.killed_at:
            raise KeyboardInterrupt
        obs, reward, success, late, info = super().step(actions)
        draws = [{"world": {"contact_friction(peg)": {"scale": 1 + 0.5 * level}}} for level in self.began]
        info |= {"record": np.array(draws, dtype=object), "_record": success | late, "success": success | late}
        return obs, reward, success, late, info


@pytest.mark.parametrize("ranges", ["schedule", "adaptive"])
def test_ranges_open_in_training_alone_and_a_killed_run_opens_them_the_same(tmp_path, ranges):
    made = []

    def toy(rows, settings):
        made.append(Drawn(rows))
        return made[-1]

    def dying(rows, settings):
        env = toy(rows, settings)
        env.killed_at = 45 if len(made) % 2 else None  # steps of all rows: after the second checkpoint, at 40
        return env

    c = config(ranges=ranges, steps=960)
    train(c, tmp_path / "whole", toy, show=False)
    made.clear()
    with pytest.raises(KeyboardInterrupt):
        train(c, tmp_path / "part", dying, show=False)
    resume(tmp_path / "part", make=toy, show=False)
    assert curve(tmp_path / "part") == curve(tmp_path / "whole")
    states = [(tmp_path / name / "checkpoints/last/state.safetensors").read_bytes() for name in ("whole", "part")]
    assert states[0] == states[1]
    levels = [float(row["level"]) for row in curve(tmp_path / "whole")]
    assert levels == sorted(levels) and levels[0] < levels[-1]
    if ranges == "schedule":
        assert levels == pytest.approx([1 / 3, 2 / 3, 1, 1, 1, 1], abs=1e-4)
    assert made[-1].level == 1.0, "evaluations are at the full ranges"


def test_ranges_of_looks_widen_and_those_that_nothing_sees_do_not_count(tmp_path):
    """Episodes in a world where only the light varies count at level 0, and their light is then nominal."""
    world = "format: vispeg-world/1\nname: light\neffects:\n- effect: ambient_light\n  where: scene\n"
    (tmp_path / "light.yaml").write_text(world + "  params: {level: {uniform: [-0.1, 0.1]}}\n")
    task = {"steps": 3, "dwell": 1}
    c = config(world=str(tmp_path / "light.yaml"), settings=task, ranges="adaptive", envs=2, episodes=1)
    with pytest.raises(UserError, match="nothing varies in this world"):
        SacRun(c, tmp_path / "blind", show=False)
    seen = replace(c, task="peg-rgb", settings={**task, "cameras": ("wrist_wide",), "image_size": 24})
    run = SacRun(seen, tmp_path / "seen", show=False)
    assert run.opening is not None and run.opening.adaptive is not None
    run.opening.begin(run.env, SAC.warmup)
    run.env.reset()
    for _ in range(3):
        _, _, dones, infos = run.env.step(np.zeros((2, run.env.action_space.shape[0])))
        run.opening.after(run.env, SAC.warmup, dones, infos)
    run.close()
    assert infos[0]["record"]["world"]["ambient_light(scene)"]["level"] == 0
    assert run.opening.adaptive.outcomes == {"ambient_light(scene)": [False, False]}


def test_ranges_are_whole_while_actions_are_random_and_a_prolonged_run_keeps_its_schedule():
    env = Sb3Env(Drawn(2))
    opening = Opening("schedule", RandomizedWorld(Drawn.ranges), 100, random=10)
    seen = []
    for step in (0, 8, 10, 25, 50, 90):
        opening.begin(env, step)
        seen.append(env.env.level)
    assert seen == [1, 1, 0.2, 0.5, 1, 1]
    longer = Opening("schedule", RandomizedWorld(Drawn.ranges), 1000, random=10)
    longer.restore(json.loads(json.dumps(opening.state())))
    longer.begin(env, 25)
    assert longer.level == 0.5


def test_ranges_that_a_world_does_not_have_are_refused_before_anything_is_written(tmp_path):
    with pytest.raises(UserError, match="ranges: nothing varies in this world"):
        train(config(ranges="adaptive"), tmp_path / "run", make("state"), show=False)
    assert not (tmp_path / "run").exists()


def test_episodes_of_the_task_widen_its_ranges():
    """The real environment's records are what the opening reads, and its next episodes are what it sets."""
    from vispeg.learn.envs import maker
    from vispeg.learn.modalities import modality

    env = Sb3Env(maker(modality("state"), "searching", SAC, 1)(2, {"steps": 1}))
    opening = Opening("adaptive", env.env.sim.world, 100, random=0)
    opening.begin(env, 0)
    env.seed(0)
    env.reset()
    for _ in range(2):
        _, _, dones, infos = env.step(np.zeros((2, 3)))
        assert dones.all() and infos[0]["record"]["world"]["hole_offset(fixture)"]["x"] == 0.0
        for info in infos:
            info["success"] = True
        opening.after(env, 0, dones, infos)
    assert set(opening.adaptive.outcomes) == {"hole_offset(fixture)", "goal_imprecision(hole)"}
    assert all(counted == [True] * 4 for counted in opening.adaptive.outcomes.values())
    assert env.env.sim.levels == opening.levels == dict.fromkeys(opening.adaptive.outcomes, 0.0)
    env.close()


@pytest.mark.parametrize(
    "settings",
    [{"dof": ("x", "y")}, {"start_height": (0.02, 0.04)}, {"reward": (("distance", -0.5), ("success", 5.0))}],
)
def test_a_run_that_is_asked_for_again_is_the_same_run(tmp_path, settings):
    """In a file tuples are lists, and whole numbers may come back as others."""
    c = config(settings=settings, stages=(Stage({"clearance": 6}), Stage()), distill={"hidden": (8, 8)})
    c.write(tmp_path / "config.yaml")
    assert same_run(c, tmp_path)
    assert not same_run(replace(c, settings={**settings, "stack": 3}), tmp_path)
