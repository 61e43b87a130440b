"""Episodes of a policy, in a worker process: each step as it can be drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.evaluation.entrants import entrant
from vispeg.evaluation.players import player
from vispeg.learn.envs import home, of_policy
from vispeg.learn.layout import ESTIMATE, OFFSET_M, PRIVILEGED
from vispeg.render.image_kinds import kind_of, picture_of
from vispeg.sim.compiled import compiled
from vispeg.task.config import TaskConfig
from vispeg.task.vector import TaskVec

MOST = 400  # steps of an episode that are played


@dataclass(frozen=True)
class Moment:
    """A step of an episode.

    Attributes:
        time: s since it began.
        qpos, bodies: of the cell, see Snapshot.
        pictures: what the policy sees, key -> (H, W, 3) uint8.
        force: (3,) N at the wrist, base axes.
        offset: (3,) mm, the tip in the goal's frame; `estimate` what the policy takes it for, None where it has none.
        outcome: how the episode ended; "" before.
    """

    time: float
    qpos: np.ndarray
    bodies: Mapping[str, np.ndarray]
    pictures: Mapping[str, np.ndarray]
    force: np.ndarray
    offset: np.ndarray
    estimate: np.ndarray | None
    outcome: str = ""


class Episodes:
    """What the page's worker holds; `tell` is told "cell" (side, MjModel, world), then "moment" (side, Moment)."""

    def __init__(self, tell: Callable[[str, Any], None]):
        self.tell = tell

    def play(self, name: str, worlds: tuple[str, ...], seed: int) -> None:
        """Plays a policy's episode of a seed in each world; "" is the world that it was trained in.

        Raises:
            UserError: no such policy or world, a policy that does not fit the world, or torch is not installed.
        """
        who = entrant(name)
        for side, world in enumerate(worlds):
            policy = None if who.scripted else player(who, None)
            at = world or ("nominal" if policy is None else home(policy))
            self.tell("say", f"{name} in {at}, seed {seed}")
            settings: dict[str, Any] = {}
            if policy is not None and not world and (clearance := (policy.meta.get("task") or {}).get("clearance_mm")):
                settings["clearance_mm"] = clearance
            env = TaskVec(1, at) if policy is None else of_policy(policy, at)(1, settings)
            try:
                config: TaskConfig = env.config  # type: ignore[attr-defined]
                self._episode(side, at, env, policy or player(who, config), seed)
            finally:
                env.close()

    def _episode(self, side: int, world: str, env: Any, policy: Any, seed: int) -> None:
        obs, _ = env.reset(seed=[seed])
        policy.reset(1)
        self.tell("cell", (side, compiled(env.sim.scene), world))
        for step in range(MOST):
            action = policy.act(obs)
            self.tell("moment", (side, _moment(env, obs, policy, step)))
            obs, _, terminated, truncated, infos = env.step(action)
            if terminated[0] or truncated[0]:
                record = infos["record"][0]
                policy.act(obs)
                last = _moment(env, obs, policy, step + 1, str(record["category"]))
                self.tell("moment", (side, last))
                return
        raise UserError("the episode has no end", key="steps", expected=f"at most {MOST}")


def _moment(env: Any, obs: Mapping[str, np.ndarray], policy: Any, step: int, outcome: str = "") -> Moment:
    snapshot = env.sim.snapshot(0)
    pictures = {key: picture_of(key, value[0]) for key, value in obs.items() if kind_of(key) is not None}
    estimate = getattr(policy, "estimate", None)
    return Moment(
        time=step * env.config.policy_period,
        qpos=snapshot.qpos,
        bodies=snapshot.bodies,
        pictures=pictures,
        force=env.sim.wrench[0, :3].copy(),
        offset=1e3 * OFFSET_M * obs[PRIVILEGED][0, ESTIMATE].astype(float),
        estimate=None if estimate is None else 1e3 * np.asarray(estimate[0], float),
        outcome=outcome,
    )
