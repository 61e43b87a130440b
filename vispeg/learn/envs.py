"""Environments for training and evaluating policies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gymnasium.vector import AutoresetMode, VectorEnv

from vispeg.core.errors import UserError
from vispeg.learn.meta import Origin, interface, made_for
from vispeg.learn.modalities import Modality, modality
from vispeg.learn.policy import Policy
from vispeg.learn.settings import SacSettings

MakeEnv = Callable[[int, Mapping[str, Any]], VectorEnv]  # (rows, task settings) -> VectorEnv without autoreset
HELD_OUT = 2**31  # seeds from here on are never drawn by training, whose seeds are below it


def maker(
    senses: Modality, world: str, sac: SacSettings, threads: int, dump: Path | None = None, engine: str = "c"
) -> MakeEnv:
    """Return a function that makes environments of a world's task, observed in one modality.

    An episode that diverges is written into the folder `dump`, if one is named, so that it can be replayed.
    """

    def make(rows: int, settings: Mapping[str, Any]) -> VectorEnv:
        from vispeg.task.environments.vector import TaskVec

        merged = {"stack": 1, **settings} if sac.recurrent else dict(settings)
        return TaskVec(
            rows,
            world,
            senses.obs_mode,
            privileged=True,
            autoreset_mode=AutoresetMode.DISABLED,
            nthread=threads,
            engine=engine,
            dump=dump,
            **merged,
        )

    return make


def describe(env: Any) -> Origin:
    """Return the entries of a policy's record on the world and task of `env`; empty for one without a task's config."""
    config = getattr(env, "config", None)
    if config is None:
        return {}
    from dataclasses import asdict

    from vispeg.task.world_file import parts, world_hash

    file = getattr(env, "file", None)
    if file is not None:
        made_of = parts(file.path)
        return {"world": file.name, "world_hash": file.hash, "world_parts": made_of, "task": asdict(config)}
    return {"world": env.world.label, "world_hash": world_hash(env.world, config), "task": asdict(config)}


def home(policy: Policy) -> str:
    """Return the world that a policy was trained in, a built-in name or a file; `nominal` if its record has none.

    Raises:
        UserError: no such file, or it is another world by now.
    """
    from vispeg.task.world_file import by_name, load_world

    meta = policy.meta
    at, known = str(meta.get("world_file") or meta.get("world") or "nominal"), meta.get("world_hash")
    if known and at not in by_name() and load_world(at).hash != known:
        raise UserError("is not the world that the policy was trained in any more: state the world", file=at)
    return at


def of_policy(policy: Policy, world: str | None = None) -> MakeEnv:
    """Return a function that makes environments with the policy's interface: stack, directions, cameras.

    Args:
        policy: the policy.
        world: name or file of the world; None for the one that the policy was trained in, with the tolerance that it
            was made for.
    """
    policy_settings = {**({} if world else made_for(policy.meta)), **interface(policy.meta)}
    make = maker(modality(policy.modality), world or home(policy), SacSettings(recurrent=policy.recurrent), 1)
    return lambda rows, settings: make(rows, {**policy_settings, **settings})
