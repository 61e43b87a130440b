"""Fine-tune a trained policy to a target world with a few demonstrations.

By default it imitates at a tenth of the learning rate that the policy was trained at. The image encoders are frozen for
the first half of the updates and then learn at a hundredth of the other networks' rate. A share of each batch comes
from the world that the policy was trained in, so that it forgets little.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.core.provenance import command_line
from vispeg.core.seeds import stream
from vispeg.interface.actions import split
from vispeg.learn.device import device_of
from vispeg.learn.envs import HELD_OUT, MakeEnv, describe, of_policy
from vispeg.learn.evaluation import run_episodes, success_rate
from vispeg.learn.experience.replay import Replay
from vispeg.learn.experience.shown import from_folder, made_in
from vispeg.learn.meta import Origin, worlds
from vispeg.learn.methods.clone import CloneSettings, clone
from vispeg.learn.methods.distill import collect, demonstrations
from vispeg.learn.policy import NetPolicy, load, save
from vispeg.learn.sb3_env import Sb3Env
from vispeg.learn.settings import defaults
from vispeg.learn.teacher import Teacher, teacher_of
from vispeg.task.start import Start


@dataclass(frozen=True)
class FinetuneSettings:
    """Settings of a fine-tuning.

    Attributes:
        demos: number of successful episodes of the teacher in the target world.
        updates: gradient steps.
        lr: initial learning rate, which falls as `CloneSettings.lr` does; None for a tenth of the one that the policy
            was trained at.
        encoders: learning rate of the image encoders in the second half of the updates, as a share of `lr`.
        known: share of each batch from the world that the policy was trained in, 0 to 0.5.
        known_steps: environment steps collected in that world.
        batch: transitions per update.
        shift: largest random shift of images, in pixels.
        rows: number of environments stepped together.
        episodes: number of episodes in each of the evaluations before and after.
    """

    demos: int = 100
    updates: int = 2_000
    lr: float | None = None
    encoders: float = 0.01
    known: float = 0.15
    known_steps: int = 2_000
    batch: int = 128
    shift: int = 1
    rows: int = 8
    episodes: int = 50

    def __post_init__(self) -> None:
        for key in ("demos", "updates", "known_steps", "batch", "rows", "episodes"):
            if getattr(self, key) < 1:
                raise UserError("must be at least 1", key=key, got=getattr(self, key))
        if self.lr is not None and not 0 < self.lr < 1:
            raise UserError("not a learning rate", key="lr", expected="above 0, below 1", got=self.lr)
        if not 0 <= self.known <= 0.5:
            raise UserError("must lie between 0 and 0.5", key="known", got=self.known)


def finetune(
    source: Path,
    out: Path,
    target: MakeEnv,
    training: MakeEnv | None,
    teacher: Callable[[Any], Teacher],
    settings: FinetuneSettings,
    seed: int,
    *,
    dataset: str | Path | None = None,
    starts: Sequence[Start] = (),
    device: str = "cpu",
    overwrite: bool = False,
    say: Callable[[str], None] = print,
) -> Path:
    """Fine-tune a policy; write the new policy and `finetune.json`, with success before and after, to a new folder.

    Args:
        source: the policy's folder.
        out: the new policy's folder.
        target: makes environments of the target world, for demonstrations and evaluations.
        training: makes environments of the world that the policy was trained in; None to learn from the target alone.
        teacher: returns the teacher for an environment.
        settings: settings of the fine-tuning.
        seed: seed of everything random.
        dataset: demonstrations in LeRobot's layout, in place of the teacher's in `target`; see `from_folder`.
        starts: starts of the teacher's episodes, used in turn; empty for those that the world draws.
        device: device of the network: `cpu`, `cuda` or `auto`.
        overwrite: whether `out` may be replaced.
        say: called with each line of progress.

    Returns:
        `out`.

    Raises:
        UserError: the policy, the teacher or the dataset does not fit the environments, the teacher fails in them, or
            `out` exists and may not be replaced.
    """
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    policy = load(source, device_of(device))
    actor = policy.actor.requires_grad_(True)
    lr = settings.lr or 0.1 * trained_at(policy)
    settings = replace(settings, lr=lr)
    dataset_folder = None if dataset is None else Path(split(str(dataset))[0])
    with new_folder(out, overwrite, holds="policy", inputs=(source, dataset_folder)) as folder:
        env = Sb3Env(target(settings.rows, {}), starts)
        teacher(env.env)  # refuse an unfit teacher before anything is played
        shown = None
        if dataset is not None:  # likewise an unfit folder
            made = getattr(env.env, "config", None)
            shown = from_folder(dataset, policy.modality, actor.layout, seed, actor.device, config=made, say=say)
        before = _success(policy, env, settings.episodes)
        say(f"before: {before:.0%} of {count(settings.episodes, 'episode')} in the target world")
        rings: list[tuple[Replay, float]] = []  # with their shares of each batch
        others: list[Origin] = []  # the worlds that it learns in, without the target
        if dataset is not None and shown is not None:
            others.append(made_in(dataset))
            say(f"{int(shown.first.sum())} demonstrations")
            rings.append((shown, 1 - settings.known))
        else:
            ring, tried = demonstrations(env, teacher(env.env), settings.demos, seed, actor.device)
            say(f"{settings.demos} demonstrations, {tried} tried")
            rings.append((ring, 1 - settings.known))
        if training is not None and settings.known > 0:
            home = Sb3Env(training(settings.rows, {}))
            ring = collect(home, teacher(home.env), None, 1.0, settings.known_steps, 0.0, seed, actor.device)
            rings.append((ring, settings.known))
            others.append(describe(home.env))
            home.close()
        imitation = CloneSettings(lr, settings.batch, settings.shift, encoders=settings.encoders)
        loss = clone(actor, rings, settings.updates, imitation, stream(seed, "finetune"), frozen=settings.updates // 2)
        after = _success(policy, env, settings.episodes)
        say(f"after: {after:.0%}, loss {loss:.4f}")
        record = {
            "before": before,
            "after": after,
            "settings": asdict(settings),
            "starts": len(starts),
            "seed": seed,
            **describe(env.env),
        }
        origin = {"command": command_line(sys.argv), "finetuned": record, "parent": str(source)}
        save(folder, actor, policy.modality, {**policy.meta, **origin, **worlds(policy.meta, record, *others)})
        (folder / "finetune.json").write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
        env.close()
    return out


def trained_at(policy: NetPolicy) -> float:
    """Return the learning rate that a policy's record states, or its recipe's default where it states none."""
    if "lr" in policy.meta:
        return float(policy.meta["lr"])
    imitated = policy.meta.get("recipe") == "distill"
    return CloneSettings.lr if imitated else defaults(bool(policy.layout.images)).lr


def _success(policy: NetPolicy, env: Sb3Env, episodes: int) -> float:
    return success_rate(run_episodes(policy, env.env, range(HELD_OUT, HELD_OUT + episodes)))


def finetune_in_worlds(
    source: Path,
    world: str,
    training: str | None,
    teacher: str,
    out: Path,
    settings: FinetuneSettings,
    seed: int,
    **more: Any,
) -> Path:
    """Run `finetune` with worlds by name or file; the policy's stack, directions and cameras are kept.

    Args:
        source, out, settings, seed: as for `finetune`.
        world: name or file of the target world.
        training: name or file of the world that the policy was trained in; None for the one in its record, with the
            tolerance that the policy was made for.
        teacher: policy folder of the teacher, or `expert`.
        more: further keyword arguments of `finetune`.
    """
    policy = load(source)
    return finetune(
        source,
        out,
        of_policy(policy, world),
        of_policy(policy, training),
        lambda env: teacher_of(teacher, env.config),
        settings,
        seed,
        **more,
    )
