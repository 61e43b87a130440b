"""Play an episode step by step for drawing: the cell's state, the policy's images, the force at the wrist."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.evaluation.entrants import Entrant
from vispeg.render.image_kinds import kind_of, picture_of
from vispeg.task.environments.vector import TaskVec

MOST = 400  # largest number of steps in an episode


@dataclass(frozen=True)
class Moment:
    """A step of an episode.

    Attributes:
        time: time since the episode began, s.
        qpos, bodies: state of the cell, see Snapshot.
        pictures: key -> image that the policy sees, (H, W, 3) uint8.
        force: (3,) N at the wrist, base axes.
        offset: (3,) mm, the tip in the goal's frame.
        estimate: (3,) mm, the policy's estimate of `offset`; None without one.
        outcome: how the episode ended; "" before its end.
    """

    time: float
    qpos: np.ndarray
    bodies: Mapping[str, np.ndarray]
    pictures: Mapping[str, np.ndarray]
    force: np.ndarray
    offset: np.ndarray
    estimate: np.ndarray | None
    outcome: str = ""


@contextmanager
def stage(who: Entrant, world: str) -> Iterator[tuple[Any, Any, str]]:
    """Yield an environment of one row, the policy, and the name of the world that it plays in.

    Args:
        who: a policy, or the scripted one.
        world: a name or a file; "" for the world that the policy was trained in, with the settings it was made for
            (`nominal` for the scripted one).

    Raises:
        UserError: no such policy or world, a policy that does not fit the world, or torch is not installed.
    """
    from vispeg.evaluation.players import player

    if who.scripted:
        at = world or "nominal"
        env: Any = TaskVec(1, at, autoreset_mode="Disabled", privileged=True)
        policy = player(who, env.config)
    else:
        from vispeg.learn.envs import home, of_policy

        policy = player(who, None)
        at = world or home(policy)
        env = of_policy(policy, world or None)(1, {})
    try:
        yield env, policy, at
    finally:
        env.close()


def moments(env: Any, policy: Any, seed: int) -> Iterator[Moment]:
    """Play the episode of a seed and yield its moments; the last one has the outcome.

    Args:
        env: a vector environment of one row without autoreset.
        policy: see `vispeg.learn.policy.Policy`.
        seed: seed of the episode.

    Raises:
        UserError: the episode has not ended after MOST steps.
    """
    obs, _ = env.reset(seed=[seed])
    policy.reset(1)
    for step in range(MOST):
        action = policy.act(obs)
        yield _moment(env, obs, policy, step)
        obs, _, terminated, truncated, infos = env.step(action)
        if terminated[0] or truncated[0]:
            policy.act(obs)  # for the policy's estimate at the end
            yield _moment(env, obs, policy, step + 1, str(infos["record"][0]["category"]))
            return
    raise UserError("the episode has no end", key="steps", expected=f"at most {MOST}")


def _moment(env: Any, obs: Mapping[str, np.ndarray], policy: Any, step: int, outcome: str = "") -> Moment:
    from vispeg.interface.terms import PRIVILEGED
    from vispeg.learn.layout import ESTIMATE, OFFSET_M

    snapshot = env.sim.snapshot(0)
    estimate = getattr(policy, "estimate", None)
    return Moment(
        time=step * env.config.policy_period,
        qpos=snapshot.qpos,
        bodies=snapshot.bodies,
        pictures={key: picture_of(key, value[0]) for key, value in obs.items() if kind_of(key) is not None},
        force=env.sim.seen.wrench[0, :3].copy(),
        offset=1e3 * OFFSET_M * obs[PRIVILEGED][0, ESTIMATE].astype(float),
        estimate=None if estimate is None else 1e3 * np.asarray(estimate[0], float),
        outcome=outcome,
    )
