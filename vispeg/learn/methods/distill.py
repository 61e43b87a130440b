"""Distil a teacher into a student: the student acts, the teacher labels each state (DAgger, Ross et al. 2011).

In round k the executed action is the teacher's with probability beta_k. Every round's observations are kept with the
teacher's actions as labels, and the student learns from all of them. By default the teacher alone acts in round 0
(beta_0 = 1). That round's transitions are demonstrations, which reinforcement learning draws from afterwards.
"""

# SB3 declares wider types for its networks and observations than those used here.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.demonstrations.looks import looking, side_by_side
from vispeg.learn.checkpoint import restart_seed
from vispeg.learn.experience.replay import Replay, afford
from vispeg.learn.methods.clone import CloneSettings, clone
from vispeg.learn.methods.rounds import RoundResult, Rounds
from vispeg.learn.methods.sac import MEASURED_ON
from vispeg.learn.networks.actor import Actor
from vispeg.learn.policy import NetPolicy
from vispeg.learn.sb3_env import Sb3Env
from vispeg.learn.teacher import Teacher


@dataclass(frozen=True)
class DistillSettings:
    """Settings of a distillation.

    Attributes:
        betas: probability that the teacher acts, for each round.
        steps: environment steps per round.
        updates: gradient steps after each round.
        looks: number of looks (draws of what only cameras see) in which each state is stored; the first is the
            episode's own.
        noise: standard deviation of noise on executed actions in rounds with 0 < beta < 1, so that the teacher shows
            how to recover. Other rounds have none: where the teacher alone acts, labels are the executed actions.
        clone: settings of the imitation.
    """

    betas: tuple[float, ...] = (1.0, 0.5, 0.25, 0.0, 0.0)
    steps: int = 4_000
    updates: int = 2_000
    looks: int = 1
    noise: float = 0.1
    clone: CloneSettings = CloneSettings()

    def __post_init__(self) -> None:
        if not self.betas or min(self.betas) < 0 or max(self.betas) > 1:
            raise UserError("must lie between 0 and 1", key="betas", got=self.betas)
        for key in ("steps", "updates", "looks"):
            if getattr(self, key) < 1:
                raise UserError("must be at least 1", key=key, got=getattr(self, key))


def collect(
    env: Sb3Env,
    teacher: Teacher,
    student: NetPolicy | None,
    beta: float,
    steps: int,
    noise: float,
    seed: int,
    device: torch.device | str = "cpu",
    looks: int = 1,
) -> Replay:
    """Play one round and return its transitions.

    Args:
        env: the student's environment.
        teacher: gives the labels.
        student: acts where the teacher does not; None where the teacher always acts.
        beta: probability that the teacher acts, drawn for every row and step.
        steps: environment steps over all rows; episodes in progress at the end are kept without their last transition.
        noise: standard deviation of noise on executed actions.
        seed: seed of the episodes, of who acts and of the noise.
        device: torch device of the batches, that of the learning network.
        looks: number of looks in which each state is stored; teacher and student act on the first.

    Returns:
        The transitions, with the teacher's actions in place of the executed ones.

    Raises:
        UserError: too little memory, or several looks where nothing that is seen varies.
    """
    n, rng = env.num_envs, stream(seed, "distill")
    length, rows = -(-steps // n), np.tile(np.arange(n), looks)
    ring = _empty_ring(env, length, seed, device, looks)
    with looking(env.env, looks):
        for obs, ends, label, reward, done, infos in _steps(env, teacher, student, beta, noise, seed, rng, length):
            observations = side_by_side(obs, looks), side_by_side(ends, looks)
            ring.add(*observations, label[rows], reward[rows], done[rows], [infos[row] for row in rows])
    ring.cut()
    return ring


def demonstrations(
    env: Sb3Env, teacher: Teacher, episodes: int, seed: int, device: torch.device | str = "cpu"
) -> tuple[Replay, int]:
    """Play a teacher until enough of its episodes have succeeded.

    Args:
        env: the student's environment.
        teacher: acts alone.
        episodes: number of successful episodes to keep.
        seed: seed of the episodes.
        device: torch device of the batches, that of the learning network.

    Returns:
        The transitions of the successful episodes, and the number of episodes played.

    Raises:
        UserError: fewer than about one in ten of the teacher's episodes succeed, or too little memory.
    """
    limit = max(10 * episodes, 4 * env.num_envs)
    # the ring holds every step of all rows, of failed episodes too, with those that begin before the last one ends
    ring = _empty_ring(env, (-(-limit // env.num_envs) + 1) * env.env.longest, seed, device)
    succeeded = tried = 0
    for obs, ends, label, reward, done, infos in _steps(
        env, teacher, None, 1.0, 0.0, seed, stream(seed, "demos"), None
    ):
        keep = np.array([bool(info.get("success", False)) for info in infos])
        for row in np.flatnonzero(done & keep):
            succeeded += 1
            keep[row] = succeeded <= episodes
        tried += int(done.sum())
        ring.add(obs, ends, label, reward, done, infos, keep)
        if succeeded >= episodes:
            break
        if tried >= limit:
            raise UserError(
                "the teacher does not succeed in this world",
                expected=f"{episodes} successes, as of a state policy that was trained in it (--teacher)",
                got=succeeded,
            )
    for row in range(env.num_envs):
        if ring.began[row] != ring.head[row]:  # an episode in progress, which has not succeeded: do not draw from it
            ring.starts[ring._span(row), row] = False
    ring.cut()
    return ring, tried


def _empty_ring(env: Sb3Env, length: int, seed: int, device: torch.device | str, looks: int = 1) -> Replay:
    """Return a ring for `length` steps of every row in every look.

    Each episode's end takes an entry of its own; there is room for one end in two steps.
    """
    rows = env.num_envs * looks
    size = rows * (length + length // 2 + 2)
    afford(size, env.observation_space, env.action_space, "--distill-steps", "a ring of what is shown")
    return Replay(size, env.observation_space, env.action_space, device, rows, seed=seed)


def _steps(
    env: Sb3Env,
    teacher: Teacher,
    student: NetPolicy | None,
    beta: float,
    noise: float,
    seed: int,
    rng: np.random.Generator,
    length: int | None,
) -> Iterator[tuple[Any, Any, np.ndarray, np.ndarray, np.ndarray, Any]]:
    """Play `length` steps of all rows, or without end for None.

    Yields:
        Of each step: the observation, the next one, the teacher's action, reward, done and infos. At an episode's end
        the next observation is the episode's last.
    """
    n = env.num_envs
    env.seed(restart_seed(seed, 0))
    obs = env.reset()
    teacher.reset(n)
    if student is not None:
        student.reset(n)
    for _ in itertools.count() if length is None else range(length):
        label = np.clip(np.asarray(teacher.act(obs), np.float32), -1, 1)
        by_teacher = rng.uniform(size=n) < beta
        action = label if student is None else np.where(by_teacher[:, None], label, student.act(obs))
        if noise:
            action = np.clip(action + noise * rng.standard_normal(action.shape), -1, 1)
        after, reward, done, infos = env.step(action.astype(np.float32))
        ends = {key: value.copy() for key, value in after.items()}
        for row in np.flatnonzero(done):
            for key, value in infos[row]["terminal_observation"].items():
                ends[key][row] = value
        yield obs, ends, label, reward, done, infos
        obs = after
        if done.any():
            teacher.reset(n, done)
            if student is not None:
                student.reset(n, done)


def distill(
    actor: Actor,
    modality: str,
    env: Sb3Env,
    teacher: Teacher,
    settings: DistillSettings,
    seed: int,
    watch: Callable[[int, float], RoundResult] | None = None,
    rounds: Rounds | None = None,
) -> list[Replay]:
    """Train `actor` in all rounds of a distillation.

    Args:
        actor: the student.
        modality: name of its modality.
        env: the student's environment.
        teacher: gives the labels.
        settings: settings of the distillation.
        seed: seed of everything drawn.
        watch: called after each round with its number and loss. Its result is stored with the round; if that has a
            true `stop`, no more rounds follow.
        rounds: stores the finished rounds; those already stored are not played again. None to store none.

    Returns:
        The rounds' transitions with the teacher's actions, first round first.
    """
    student = NetPolicy(actor, modality)

    def played(number: int, beta: float) -> Replay:
        acting = None if beta >= 1 else student
        noise = settings.noise if 0 < beta < 1 else 0.0
        # round 0 keeps the seed itself, so that runs of one round stay as they were
        round_seed = int(stream(seed, "distill round", number).integers(2**30)) if number else seed
        steps, looks = settings.steps, settings.looks
        return collect(env, teacher, acting, beta, steps, noise, round_seed, actor.device, looks)

    return _learn(actor, [], played, settings, seed, watch, rounds)


def imitate(
    actor: Actor,
    demos: Replay,
    settings: DistillSettings,
    seed: int,
    watch: Callable[[int, float], RoundResult] | None,
    rounds: Rounds | None,
) -> None:
    """Train `actor` by behaviour cloning, with as many rounds and updates as `distill` but without playing.

    Args:
        actor: the student.
        demos: transitions with the actions to imitate.
        settings, seed, watch, rounds: as for `distill`.
    """
    _learn(actor, [demos], None, settings, seed, watch, rounds)


def _learn(
    actor: Actor,
    demos: list[Replay],
    played: Callable[[int, float], Replay] | None,
    settings: DistillSettings,
    seed: int,
    watch: Callable[[int, float], RoundResult] | None,
    rounds: Rounds | None,
) -> list[Replay]:
    """Run the rounds: in each play if there is `played`, then clone from all transitions so far.

    Args:
        actor: the student.
        demos: transitions that are there before the first round.
        played: plays the round of a number and beta, and returns its transitions; None to play nothing.
        settings, seed, watch, rounds: as for `distill`.

    Returns:
        `demos` and the transitions of all rounds, in order.
    """
    optimizer = torch.optim.Adam(actor.parameters(), settings.clone.lr, fused=True)
    done, rings = 0, list(demos)
    if rounds is not None:
        rounds.restore(actor, optimizer)
        state = rounds.state
        done = len(settings.betas) if state is not None and state.get("stop") else rounds.done
        rings += rounds.rings() if played is not None else []
    for number, beta in list(enumerate(settings.betas))[done:]:
        fresh = None if played is None else played(number, beta)
        rings += [] if fresh is None else [fresh]
        if number == 0:
            actor.scale.measure(actor.vector(rings[0].sample(MEASURED_ON, images="none").obs))
        shares = [(ring, float(len(ring))) for ring in rings]
        rng = stream(seed, "clone", number)
        loss = clone(actor, shares, settings.updates, settings.clone, rng, optimizer=optimizer)
        result: RoundResult = watch(number, loss) if watch is not None else {}
        if rounds is not None:
            rounds.keep(fresh, actor, optimizer, result)
        if result.get("stop"):
            break
    return rings
