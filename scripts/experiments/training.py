"""State policies by SAC in folders of their own: a run that was finished is kept, one that was killed goes on."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.formats.json_data import read_json
from vispeg.learn.config import Stage, TrainConfig, read_config
from vispeg.learn.methods.distill import DistillSettings
from vispeg.learn.settings import SacSettings
from vispeg.task.peg.config import PegConfig

LEVELS, PASS = (0.0, 0.5, 1.0), 0.5  # of gated ranges: how far open, and success in an evaluation that opens them on
NEVER_EARLY = 2.0  # a success rate that no run reaches, so that every run takes the whole budget


@dataclass(frozen=True)
class Variant:
    """A way to train.

    Attributes:
        name: of its policies in results and folders.
        world: that it trains in, a built-in name or a file.
        stack: observations and actions that a feed-forward actor sees; a recurrent one sees the last alone.
        recurrent: width of the actor's LSTM, 0 for a feed-forward actor.
        modality: what the policy sees.
        reward: of the task, see vispeg.task.peg.rewards.
        dof: directions that the policy moves.
        ranges: how the world's ranges open, see TrainConfig; `gated` opens them by `LEVELS`, each once the last is
            learned; its random actions, which set the networks' input scales, and its evaluations are at the level too.
        teacher: policy that it imitates; "" where it learns by reinforcement.
        looks: in which an imitator sees each state.
        begun: how it was trained for the first half of the steps, with all of its memory; None: from nothing.
    """

    name: str
    world: str
    stack: int = 2
    recurrent: int = 0
    modality: str = "state"
    reward: str = "shaped"
    dof: tuple[str, ...] = ("x", "y", "z")
    ranges: str = "full"
    teacher: str = ""
    looks: int = 1
    begun: Variant | None = None


@dataclass(frozen=True)
class Budget:
    """What every run may spend.

    Attributes:
        steps: environment steps, at most.
        every: steps between evaluations in its own training world.
        episodes: of an evaluation.
        until: success rate in an evaluation that ends a run early, once two in a row reach it over whole ranges.
    """

    steps: int
    every: int
    episodes: int
    until: float = NEVER_EARLY


def configuration(variant: Variant, seed: int, budget: Budget) -> TrainConfig:
    """Return the run's configuration; all variants differ in what `Variant` names alone. The task's own values go
    unsaid.
    """
    settings = {"stack": 1 if variant.recurrent else variant.stack}
    settings |= {} if variant.reward == PegConfig.reward else {"reward": variant.reward}
    settings |= {} if variant.dof == PegConfig.dof else {"dof": list(variant.dof)}
    gated = {"stages": tuple(Stage(level=level) for level in LEVELS), "pass_rate": PASS}
    recipe = {"recipe": "distill", "teacher": variant.teacher, "distill": rounds(variant, budget)}
    return TrainConfig(
        task=f"peg-{variant.modality}",
        world=variant.world,
        steps=budget.steps,
        seed=seed,
        every=budget.every,
        episodes=budget.episodes,
        target=budget.until,
        settings=settings,
        sac=SacSettings(recurrent=variant.recurrent),
        **(gated if variant.ranges == "gated" else {"ranges": variant.ranges}),
        **(recipe if variant.teacher else {}),
    )


def rounds(variant: Variant, budget: Budget) -> dict[str, int]:
    """Return the settings of an imitator's rounds, which share the budget; half as many updates as steps, as by
    default.
    """
    steps = max(1, budget.steps // len(DistillSettings.betas))
    return {"steps": steps, "updates": max(1, steps // 2), "looks": variant.looks}


def run_folder(runs: Path, variant: Variant, seed: int) -> Path:
    """Return the folder of a run."""
    return runs / f"{variant.name}_s{seed}"


def trained(runs: Path, variant: Variant, seed: int, budget: Budget) -> Path:
    """Return the run's folder, trained to the budget's end or until it is good enough; a run that was stopped goes on
    from its last checkpoint.

    Raises:
        UserError: the folder holds a run that was asked for otherwise, or of more steps.
    """
    from vispeg.learn.run_folder import settled
    from vispeg.learn.train import resume, train

    folder, wanted = run_folder(runs, variant, seed), settled(configuration(variant, seed, budget))
    if not (folder / "config.yaml").is_file() and variant.begun is not None:
        half = replace(budget, steps=budget.steps // 2)
        first = trained(runs, variant.begun, seed, half)
        with new_folder(folder) as copy:
            shutil.copytree(first, copy, dirs_exist_ok=True)
            shutil.rmtree(copy / "checkpoints" / "best", ignore_errors=True)  # of the other world
            state = copy / "checkpoints" / "last" / "state.json"
            kept = read_json(state, finite=False)
            kept["counters"] |= {"best": [-1.0, 0.0], "reached": 0}
            state.write_text(json.dumps(kept) + "\n", encoding="utf-8")
            replace(wanted, steps=half.steps).write(copy / "config.yaml")
    if not (folder / "config.yaml").is_file():
        train(wanted, folder)
        return folder
    known = read_config(folder / "config.yaml")
    if replace(known, steps=wanted.steps) != wanted or known.steps > wanted.steps:
        raise UserError("was trained otherwise; name another folder with --runs", file=folder, got=known.steps)
    if wanted.recipe == "distill":  # goes on after its last round; nothing is left to do for one that is finished
        resume(folder)
    elif not (folder / "checkpoints" / "last").is_dir():  # killed before its first checkpoint
        shutil.rmtree(folder)
        train(wanted, folder)
    elif steps_done(folder) < wanted.steps and not good_enough(folder):
        resume(folder, wanted.steps)
    return folder


def good_enough(folder: Path) -> bool:
    """Whether a run ended early, since its last two evaluations reached the budget's `until`."""
    return read_json(folder / "checkpoints" / "last" / "state.json", finite=False)["counters"]["reached"] >= 2


def steps_done(folder: Path) -> int:
    """Return the environment steps up to the run's last evaluation; 0 before its first."""
    path = folder / "progress.csv"
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    return int(lines[-1].split(",")[0]) if len(lines) > 1 else 0
