"""The policies to evaluate: each has a name, an observation modality and the seed that it was trained with."""

from __future__ import annotations

import hashlib
import re
import uuid
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.core.extras import require
from vispeg.core.provenance import digest
from vispeg.evaluation import own
from vispeg.interface.actions import OFFSET, STATED, split
from vispeg.learn.meta import interface, tolerance_of, worlds
from vispeg.learn.record import policy_digest, read_record
from vispeg.learn.shipped import policy_folder
from vispeg.task.world_file import built_in, parts

OBJECT = "object:"  # begins the digest of a policy that is an object, which nobody can compute again
EXPERT = "expert"  # name of a task's scripted policy
# A text, a path, an object that acts, a mapping of names to these, or a sequence of these.
Policies = str | Path | Sequence[str | Path] | Any
TRAINING = "S"  # the frozen training world; any policy may have been trained with its parts


@dataclass(frozen=True)
class Entrant:
    """A policy that takes part in an evaluation.

    Attributes:
        name: its name in tables; replicas that differ only in `train_seed` share it.
        path: its folder; for a user's own policy the file that defines it, or its name.
        modality: name of what it observes.
        train_seed: seed of its training.
        trained_on: hashes of the worlds that it was trained or fine-tuned in.
        task: the task's settings that it was made for (stack, dof, cameras, ...).
        digest: SHA-256 of its files; for an object, a text that no other object has.
        parts: hash -> name of the parts of those worlds, see `vispeg.task.world_file.parts`.
        tolerance: the tolerance that it was made for, see `vispeg.task.config.Tolerance`; None if it states none.
        source: for a user's own policy (`vispeg.evaluation.own`) the text that names it, or the object; else None.
        alone: whether it plays one episode at a time.
        measured: whether it asks for readings in SI units.
        exported: for an .onnx file by `vispeg export` the digest of the policy that it was made from, which trials
            state; else empty.
    """

    name: str
    path: Path
    modality: str
    train_seed: int
    trained_on: tuple[str, ...]
    task: Mapping[str, Any]
    digest: str
    parts: Mapping[str, str] = field(default_factory=dict)
    tolerance: float | None = None
    source: Any = None
    alone: bool = False
    measured: bool = False
    exported: str = ""

    @property
    def stored(self) -> bool:
        """Whether it is loaded by a path or a name; False for an object and for the scripted policy."""
        return not self.scripted and (self.source is None or isinstance(self.source, str))

    @property
    def scripted(self) -> bool:
        """Whether it is the scripted policy, which was not trained."""
        return self.digest == EXPERT


def entrant(text: str) -> Entrant:
    """Return the policy that a text names: `FOLDER`, `NAME=FOLDER`, or `expert` (the scripted policy).

    FOLDER may also be the name of a shipped policy, or what `vispeg.evaluation.own` accepts: `MODULE:NAME`, an .onnx
    file, a .zip by Stable-Baselines3, or `lerobot:FOLDER`, each followed by `?action=KIND` if its actions are not
    offsets.

    Without NAME, the name is the folder's without a training seed at its end (`depth_s2` -> `depth`); for a checkpoint
    in a run's folder it is the task's.

    Raises:
        UserError: no such policy, a folder without a readable policy.json, or torch is not installed.
    """
    stated, kind = split(text)
    name, _, place = stated.rpartition("=")
    if own.is_own(place):
        return _own(name or own.called(place), place if kind is None else f"{place}{STATED}{kind}")
    if kind is not None:
        what = "only for a policy of your own: others state the kind of their actions"
        raise UserError(what, key="action", got=text)
    if place == EXPERT:
        return Entrant(name or EXPERT, Path(EXPERT), "state", 0, (), {}, EXPERT)
    path = policy_folder(place, [EXPERT])
    require("torch", f"the policy {place}")
    record = read_record(path)
    meta = record["meta"]
    seed = meta.get("seed", 0)
    seed = seed if isinstance(seed, int) else 0
    stem = _stem(path)
    made_in = worlds(meta)
    return Entrant(
        name or re.sub(rf"[-_.]?s(eed)?{seed}$", "", stem) or stem,
        path,
        str(record.get("modality", "")),
        seed,
        tuple(made_in["world_hashes"]),
        interface(meta),
        policy_digest(path),
        made_in["world_parts"],
        tolerance_of(meta),
    )


def _own(name: str, source: Any) -> Entrant:
    """Return a user's own policy. Raises UserError if it is not one, or if what it observes is unknown or forbidden."""
    target = own.made(source)
    mode, task = own.observes(target, name)
    path, action = own.origin(source), own.acts(source, target)
    digest_of = digest(path) if path is not None else f"{OBJECT}{uuid.uuid4().hex}"
    if path is not None and split(source)[1] is not None:  # with another kind of actions it is another policy
        digest_of = hashlib.sha256(f"{digest_of} {action}".encode()).hexdigest()
    made_in = own.made_in(target)
    return Entrant(
        name,
        Path(name) if path is None else path,
        mode,
        0,
        tuple(made_in["world_hashes"]),
        task,
        digest_of,
        made_in["world_parts"],
        source=source if isinstance(source, str) else target,
        alone=own.plays_alone(target),
        # other actions than offsets are converted with the arm's readings
        measured=action not in (None, OFFSET) or bool(getattr(target, "measured", False)),
        exported=own.exported(target),
    )


def given(policies: Policies) -> list[tuple[str, Any]]:
    """Return (name, policy) of each policy in `policies`; the name is "" where none is given."""
    if isinstance(policies, Mapping):
        return [(str(name), policy) for name, policy in policies.items()]
    if isinstance(policies, Path):
        return [("", str(policies))]
    if isinstance(policies, Sequence) and not isinstance(policies, str):
        return [pair for one in policies for pair in given(one)]
    return [("", policies)]


def entrants(policies: Policies) -> list[Entrant]:
    """Return all the policies as entrants.

    Raises:
        UserError: none given, one is not a policy, or two have the same name and training seed.
    """
    pairs = given(policies)
    if not pairs:
        raise UserError("no policy given", expected="a policy's folder, or NAME=FOLDER")
    chosen = []
    for name, policy in pairs:
        if isinstance(policy, str | Path):
            chosen.append(entrant(f"{name}={policy}" if name else str(policy)))
        else:
            default = getattr(policy, "__name__", type(policy).__name__)  # not an identifier for a lambda
            chosen.append(_own(name or (default if default.isidentifier() else "policy"), policy))
    earlier: dict[tuple[str, int], Entrant] = {}
    for e in chosen:
        other = earlier.setdefault((e.name, e.train_seed), e)
        if other is not e:
            raise UserError(
                f"two policies called {e.name} with training seed {e.train_seed}",
                expected="NAME=FOLDER",
                got=f"{other.path}, {e.path}",
            )
    return chosen


def refuse_trained_on(
    who: Iterable[Entrant],
    world: str,
    world_hash: str,
    source: str | Path | None = None,
    training: str | Path = TRAINING,
) -> None:
    """Refuse policies that were trained in the target world or with parts of it: success there would not be transfer.

    Training includes fine-tuning, and only held-out parts count. For example, a policy trained in V is refused for VNP,
    which has the same looks; so is one trained in P, which has the same plant.

    Args:
        who: the policies.
        world, world_hash: the target's name and hash.
        source: the target's file; None for the built-in world of that name.
        training: the comparison's training world; its parts and those of S are not held out.

    Raises:
        UserError: a policy was trained in the target or with parts of it; the error names the shared parts.
    """
    if source is None and world in built_in():
        source = world
    training_parts = parts(TRAINING) | parts(training)
    held_out = {} if source is None else {h: name for h, name in parts(source).items() if h not in training_parts}
    for e in who:
        if world_hash and world_hash in e.trained_on:
            raise UserError(
                f"{e.name} was trained in {world}, so its success there is no transfer",
                file=e.path,
                expected="another target, or --fine-tuned",
                got=world_hash[:12],
            )
        if shared := [name for h, name in held_out.items() if h in e.parts]:
            reason = f"{e.name} was trained with {', '.join(shared)}, which {world} has too"
            raise UserError(
                f"{reason}, so its success there is no transfer",
                file=e.path,
                expected="another target, or --fine-tuned",
            )


def _stem(path: Path) -> str:
    """Return the folder's name; for a run's checkpoint (runs/TASK/TIME_sSEED/checkpoints/best) that of the task.

    For an intermediate checkpoint it is the task's name with its steps or updates: `LABEL-depth@8000` for
    checkpoints/steps-8000, `LABEL-depth@updates-8000` for checkpoints/updates-8000.
    """
    place = path.resolve()
    if match := re.fullmatch(r"steps-(\d+)|(updates-\d+)", place.name):
        return f"{_stem(place.parent)}@{match[1] or match[2]}"
    while place.name in ("best", "last", "checkpoints") or re.match(r"\d{8}-\d{4}", place.name):
        place = place.parent
    return place.name or path.resolve().name
