"""One training run with SAC: environments, model, checkpoints, evaluations and the best policy so far."""

# SB3 declares wider types for its networks and observations than those used here.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.logger import Logger

from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.core.provenance import command_line, provenance
from vispeg.learn.checkpoint import Counters, load_state, restart_seed, save_state
from vispeg.learn.config import TrainConfig
from vispeg.learn.curves.loggers import curves, record
from vispeg.learn.curves.progress import Bar, Row, Table, Watch, failures
from vispeg.learn.device import device_of
from vispeg.learn.envs import HELD_OUT, MakeEnv, describe, maker
from vispeg.learn.evaluation import Outcome, run_episodes, success_rate
from vispeg.learn.experience.replay import afford
from vispeg.learn.experience.shown import from_folder, made_in
from vispeg.learn.meta import worlds
from vispeg.learn.methods.clone import CloneSettings
from vispeg.learn.methods.curriculum import Curriculum
from vispeg.learn.methods.ranges import Opening
from vispeg.learn.methods.rounds import kept_ring
from vispeg.learn.methods.sac import AsymmetricSAC
from vispeg.learn.modalities import modality as modality_of
from vispeg.learn.policy import NetPolicy, save
from vispeg.learn.run_folder import begun_by
from vispeg.learn.sb3_env import Sb3Env
from vispeg.worlds.randomized import RandomizedWorld

DIVERGED = "diverged"  # folder for a run's episodes whose simulation diverged, to be replayed
EVALUATION_ROWS = 25  # largest number of environments that an evaluation steps together


class SacRun:
    """One run in its folder; see `train` and `resume`.

    Args:
        config: the run's configuration.
        folder: the run's folder.
        make: makes the environments; None for those of the configuration's world.
        show: whether to print progress to stderr.
    """

    def __init__(
        self,
        config: TrainConfig,
        folder: Path,
        make: MakeEnv | None = None,
        show: bool = True,
    ):
        torch.set_num_threads(config.threads)
        self.config, self.folder, self.show = config, folder, show
        self.modality = modality_of(config.modality)
        inputs = self.modality, config.world, config.sac, config.threads, folder / DIVERGED
        self.make, self.make_judge = make or maker(*inputs, config.engine), make or maker(*inputs)
        self.course = Curriculum(config.stages, config.pass_rate)
        self.env, self.judge = self._environments()  # of training, and of evaluations
        self.opening: Opening | None = None
        if config.ranges != "full":
            world = RandomizedWorld(getattr(self.env.env, "ranges", ()))
            self.opening = Opening(config.ranges, world, config.steps, config.sac.warmup)
        device = device_of(config.device)
        if config.recipe != "distill":
            # an episode's end takes an entry of its own; episodes last ten steps or more
            entries = min(config.sac.replay, config.steps + config.steps // 10)
            memory = afford(entries, self.env.observation_space, self.env.action_space, "--replay", "replay")
            if show:
                print(memory, file=sys.stderr)
        self.model = AsymmetricSAC(self.env, self.modality, config.sac, seed=config.seed, device=device)
        self.model.set_logger(Logger(None, []))
        if config.dataset is not None and config.recipe != "distill":
            self.model.demos = from_folder(
                config.dataset,
                self.modality.name,
                self.model.actor.layout,
                config.seed,
                self.model.device,
                beside=self.model.replay.observation_space,
                config=getattr(self.env.env, "config", None),
            )
        self.best: tuple[float, float] = (-1.0, 0.0)  # success, and mean peak force in N with a minus sign
        self.reached = 0  # number of latest evaluations in a row that reached the target
        self.recent: deque[tuple[bool, str]] = deque(maxlen=100)  # success and category of the last training episodes
        self.command = begun_by(folder) or command_line(sys.argv)

    @property
    def ended(self) -> bool:
        """Whether the two last evaluations reached the target."""
        return self.reached >= 2

    def _environments(self) -> tuple[Sb3Env, Any]:
        settings = self.course.settings(self.config.settings)
        env = self.make(self.config.envs, settings)
        judge = self.make_judge(min(self.config.episodes, EVALUATION_ROWS), settings)
        for vec in (env, judge):
            if hasattr(vec, "set_level"):
                vec.set_level(self.course.stage.level)
        return Sb3Env(env), judge

    def resume(self) -> None:
        """Restore the last checkpoint. Raises UserError where there is none."""
        folder = self.folder / "checkpoints" / "last"
        if not folder.is_dir():
            raise UserError("there is no checkpoint to resume from", file=folder)
        counters = load_state(folder, self.model)
        self.command = counters.get("command", self.command)  # the command that began the run, not this one
        self.best, self.reached = (counters["best"][0], counters["best"][1]), counters["reached"]
        self.recent.extend((bool(success), str(category)) for success, category in counters["recent"])
        if self.opening is not None and counters.get("ranges"):
            self.opening.restore(counters["ranges"])
        if counters["stage"] != self.course.at:
            self._move_to(counters["stage"])
        if (self.folder / "demos").is_dir():
            self.model.demos = kept_ring(self.folder / "demos", self.model.replay)

    def _move_to(self, stage: int) -> None:
        self.env.close()
        self.judge.close()
        self.course.at = stage
        self.env, self.judge = self._environments()
        self.model.set_env(self.env, force_reset=False)

    def _restart(self) -> None:
        if self.opening is not None:
            self.opening.begin(self.env, self.model.num_timesteps)
        self.model.restart(restart_seed(self.config.seed, self.model.num_timesteps))

    def run(self) -> Path:
        """Train until the configuration's steps or its target success are reached; return the best policy's folder."""
        c, model = self.config, self.model
        table = Table(self.folder / "progress.csv", model.num_timesteps)
        started = time.monotonic() - table.seconds
        logger = curves(self.folder, c)
        model.set_logger(logger)
        with Bar(c.steps, self.show) as bar:
            watch = Watch(bar, self.recent, self.opening)
            self._restart()
            while model.num_timesteps < c.steps and not self.ended:
                goal = min((model.num_timesteps // c.every + 1) * c.every, c.steps)
                model.learn(goal - model.num_timesteps, watch, log_interval=None, reset_num_timesteps=False)
                outcomes = self.evaluate()
                level = None if self.opening is None else self.opening.level
                row = self.row(outcomes, time.monotonic() - started)
                row["train_success"], row["level"] = watch.success, level
                table.add(row)  # before the checkpoint: a resumed run drops later rows
                self._finish_evaluation(row)
                record(logger, row, "eval", model.num_timesteps)
                bar.say(line(row))
                self._restart()
        logger.close()
        return self.close()

    def close(self) -> Path:
        """Close the environments; return the best policy's folder, or that of the last checkpoint if there is none."""
        self.env.close()
        self.judge.close()
        best = self.folder / "checkpoints" / "best"
        return best if best.is_dir() else self.folder / "checkpoints" / "last"

    def evaluate(self) -> list[Outcome]:
        """Play the present actor on held-out seeds, without exploration noise; return the outcomes."""
        policy = NetPolicy(self.model.actor, self.modality.name)
        return run_episodes(policy, self.judge, range(HELD_OUT, HELD_OUT + self.config.episodes))

    def row(self, outcomes: list[Outcome], seconds: float) -> Row:
        """Return a row of progress.csv for these outcomes, after this many seconds of the run."""
        values = self.model.logger.name_to_value
        return {
            "steps": self.model.num_timesteps,
            "seconds": seconds,
            "updates": self.model._n_updates,
            "stage": self.course.at,
            "success": success_rate(outcomes),
            "reward": float(np.mean([o.reward for o in outcomes])),
            "peak_force": float(np.mean([o.info.get("peak_force", 0.0) for o in outcomes])),
            "episode_steps": float(np.mean([o.steps for o in outcomes])),
            "failures": failures([o.category for o in outcomes]),
            "critic_loss": values.get("train/critic_loss"),
            "actor_loss": values.get("train/actor_loss"),
            "entropy": values.get("train/entropy"),
            "temperature": values.get("train/temperature"),
        }

    def keep(self, row: Row, name: str, contender: bool = True) -> None:
        """Save the actor as `checkpoints/NAME`, and as `checkpoints/best` if it is better.

        It is better with more successes, or with as many and a smaller mean peak force. Every evaluation's actor is
        kept, because a study of how success in one world predicts success in another needs policies of all qualities.

        Args:
            row: the evaluation's row of progress.csv.
            name: `steps-N` for reinforcement learning, `updates-N` for imitation, which counts other steps.
            contender: whether it may become the best.
        """
        places = [name]
        score = row["success"], -row["peak_force"]
        if contender and score > self.best:
            self.best = score
            places.append("best")
        for place in places:
            with new_folder(self.folder / "checkpoints" / place, overwrite=True, holds=None) as part:
                save(part, self.model.actor, self.modality.name, self.meta(row))

    def _finish_evaluation(self, row: Row) -> None:
        """Save the policy, update the curriculum, write the checkpoint."""
        success, last = row["success"], self.course.last
        self.keep(row, f"steps-{row['steps']}", last)
        self.reached = self.reached + 1 if last and success >= self.config.target else 0
        moved = self.course.after(success)
        counters: Counters = {
            "command": self.command,
            "stage": self.course.at,
            "best": list(self.best),
            "reached": self.reached,
            "recent": [*self.recent],
            "ranges": None if self.opening is None else self.opening.state(),
        }
        with new_folder(self.folder / "checkpoints" / "last", overwrite=True, holds=None) as place:
            save(place, self.model.actor, self.modality.name, self.meta(row))
            save_state(place, self.model, counters)
        if moved:
            self._move_to(self.course.at)

    def meta(self, row: Row) -> Mapping[str, object]:
        """Return the entries of a policy's record on its origin."""
        origin = provenance(sys.argv, self.config.seed)
        entries = {
            "command": self.command,
            "seed": self.config.seed,
            "recipe": self.config.recipe,
            "lr": CloneSettings.lr if self.config.recipe == "distill" else self.config.sac.lr,
            "world_file": self.config.world,
            "steps": row["steps"],
            "success": row["success"],
            "versions": origin["versions"] | {"torch": torch.__version__},
        }
        world = describe(self.judge)
        if self.config.dataset is None:
            return entries | world
        return entries | world | worlds(world, made_in(self.config.dataset))


def line(row: Row) -> str:
    """Return a row of progress.csv as a line for the terminal."""
    ranges = "" if (level := row.get("level")) is None else f"  ranges {level:4.0%}"
    return (
        f"{row['steps']:>8} steps {row['seconds']:6.0f} s  success {row['success']:4.0%}  "
        f"force {row['peak_force']:5.1f} N  stage {row['stage']}{ranges}  {row['failures']}"
    )
