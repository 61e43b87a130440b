"""Play a job's episodes: load the policy, make the task's vector environment, and put the controls between them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.evaluation.controls import ON_IMAGES, Controlled
from vispeg.evaluation.jobs import Job, Pushes
from vispeg.evaluation.players import player
from vispeg.evaluation.records import Episode
from vispeg.evaluation.remainder import Remainder
from vispeg.evaluation.replay import Begun
from vispeg.trials.kept import Kept
from vispeg.trials.trial import PolicyPart

if TYPE_CHECKING:  # which needs torch
    from vispeg.learn.evaluation import Outcome

_kept: dict[Any, Any] = {}  # this worker's last environment: successive jobs mostly need the same one


def play(job: Job) -> list[Episode]:
    """Play the episodes of a job; return them in the order of its seeds.

    Raises:
        UserError: a policy made for another observation, or an invalid world.
    """
    from vispeg.learn.evaluation import SPARE, run_episodes

    env: Any = environment(job)
    vec, who = env, job.entrant
    policy: Any = player(who, env.config)
    spare: list[int] = []  # seeds of episodes that do not count
    if job.control in ON_IMAGES:
        policy = Controlled(policy, job.control, env.num_envs)
        spare = [job.seeds[0] + SPARE + k for k in range(policy.spare)]
    if job.pushes is not None:
        env = Pushed(env, job.pushes)
    if job.remainder is not None:
        env = Disturbed(env, job.remainder)
    if job.replays is not None:
        env = Begun(env, job.replays)
    if job.trials is not None:
        part = PolicyPart(name=who.name, digest=who.digest, modality=who.modality, train_seed=who.train_seed)
        stem = f"{who.name}_s{who.train_seed}-{job.world_name}"
        env = Kept(env, vec, part, job.trials, stem, job.seeds, job.world_name, job.world_hash)
    return [episode(job, outcome) for outcome in run_episodes(policy, env, [*spare, *job.seeds])[len(spare) :]]


def environment(job: Job, render_mode: str | None = None) -> Any:
    """Return the vector environment of a job; the last job's is used again if it is the same."""
    from vispeg.learn.modalities import modality
    from vispeg.task.environments.vector import TaskVec

    who = job.entrant
    obs_mode = modality(who.modality).obs_mode
    key = (job.world, job.world_hash, obs_mode, str(who.task), who.measured, job.rows, render_mode, job.dump)
    if key not in _kept:
        for old in _kept.values():
            old.close()
        _kept.clear()
        _kept[key] = TaskVec(
            job.rows,
            job.world,
            obs_mode,
            privileged=True,  # for policies that are teachers; `own.Own` hides it from a user's own
            measured=who.measured,
            render_mode=render_mode,
            autoreset_mode="Disabled",
            dump=job.dump,
            **who.task,
        )
    return _kept[key]


def episode(job: Job, outcome: Outcome) -> Episode:
    """Return the record of one finished episode (see `vispeg.learn.evaluation.Outcome`)."""
    info = outcome.info
    forces = np.asarray(info.get("force_profile", ()), float)
    steps = max(1, outcome.steps)
    keys = ("time", "peak_force", "lateral_error", "depth", "clipped")
    time, peak_force, lateral_error, depth, clipped = (float(info.get(key, np.nan)) for key in keys)
    per_step = [float(part.max()) for part in np.array_split(forces, steps) if part.size]
    return Episode(
        policy=job.entrant.name,
        modality=job.entrant.modality,
        train_seed=job.entrant.train_seed,
        world=job.world_name,
        world_hash=job.world_hash,
        seed=int(outcome.seed),
        success=bool(outcome.success),
        category=str(outcome.category),
        time=time,
        peak_force=peak_force,
        lateral_error=lateral_error,
        depth=depth,
        clipped=clipped,
        control=job.control,
        configuration=job.configuration,
        force_profile=tuple(per_step) if job.profile else None,
    )


class Pushed:
    """An environment in which the arm is pushed once in every episode."""

    def __init__(self, env: Any, pushes: Pushes):
        self.env, self.pushes, self.num_envs = env, pushes, env.num_envs

    def reset(self, *, seed: Any = None, options: Mapping[str, np.ndarray] | None = None) -> Any:
        """Reset as the environment does; each row that begins an episode gets the push of its seed."""
        result = self.env.reset(seed=seed, options=options)
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool))
        for row in np.flatnonzero(mask):
            force, start, duration = self.pushes.draw(int(seed[row]))
            self.env.push([int(row)], force, start, duration)
        return result

    def step(self, actions: np.ndarray) -> Any:
        """Step as the environment does."""
        return self.env.step(actions)


class Disturbed:
    """An environment whose arm is disturbed by the torque that a model leaves unexplained.

    The torque is resampled with the episode's seed.
    """

    def __init__(self, env: Any, remainder: Remainder):
        self.env, self.remainder, self.num_envs = env, remainder, env.num_envs
        self.ticks = env.config.steps * env.config.ticks

    def reset(self, *, seed: Any = None, options: Mapping[str, np.ndarray] | None = None) -> Any:
        """Reset as the environment does; each row that begins an episode gets the torques of its seed."""
        result = self.env.reset(seed=seed, options=options)
        mask = (options or {}).get("reset_mask", np.ones(self.num_envs, dtype=bool))
        for row in np.flatnonzero(mask).tolist():
            self.env.disturb(row, self.remainder.draw(int(seed[row]), self.ticks))
        return result

    def step(self, actions: np.ndarray) -> Any:
        """Step as the environment does."""
        return self.env.step(actions)
