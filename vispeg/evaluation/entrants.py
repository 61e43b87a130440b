"""Who is evaluated: a policy with the name, modality and training seed under which its episodes stand."""

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
from vispeg.learn.record import read_record
from vispeg.learn.shipped import policy_folder
from vispeg.task.world_file import built_in, parts

EXPERT = "expert"  # the scripted policy of a task takes part under this name
# A text, a path, an object that acts, a mapping of names to these, or a sequence of these.
Policies = str | Path | Sequence[str | Path] | Any
TRAINING = "S"  # the frozen training world; what it is made of is held out from nobody


@dataclass(frozen=True)
class Entrant:
    """A policy that takes part.

    Attributes:
        name: in tables; replicas that differ in `train_seed` only share it.
        path: of its folder; of a policy of the user's own the file that it is in, or its name.
        modality: what it observes.
        train_seed: of its training.
        trained_on: hashes of the worlds it was trained or fine-tuned in.
        task: the part of the task that it was made for (stack, dof, cameras, ...).
        digest: SHA-256 of its folder or file; of an object, one that no other object has.
        parts: what those worlds are put together from, see `vispeg.task.world_file.parts`.
        tolerance: that it was made for, see `vispeg.task.config.Tolerance`; None where it does not say.
        source: of a policy of the user's own (`vispeg.evaluation.own`), the text that names it, or the object.
        alone: whether it plays one episode at a time.
        measured: whether it asks for readings in SI units.
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

    @property
    def stored(self) -> bool:
        """Whether it can be read again from `path`."""
        return not self.scripted and (self.source is None or isinstance(self.source, str))

    @property
    def scripted(self) -> bool:
        """Whether it is the scripted policy, which nobody trained."""
        return self.digest == EXPERT


def entrant(text: str) -> Entrant:
    """`FOLDER`, `NAME=FOLDER`, or `expert` (the scripted policy). A folder that is not there may be a shipped policy.

    In place of FOLDER may stand what `vispeg.evaluation.own` takes: `MODULE:NAME`, an .onnx, a .zip by
    Stable-Baselines3, or `lerobot:FOLDER`, each with `?action=KIND` behind it where its actions are no offsets.

    Without NAME, the folder's name counts, less a training seed at its end (`depth_s2` -> `depth`); of a checkpoint in
    a run's folder, the task's.

    Raises:
        UserError: no such policy, a folder without a readable policy.json, no torch to play it with.
    """
    stated, kind = split(text)
    name, _, place = stated.rpartition("=")
    if own.is_own(place):
        return _own(name or own.called(place), place if kind is None else f"{place}{STATED}{kind}")
    if kind is not None:
        what = "only of a policy of your own, for another one states what its actions mean"
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
        digest(path),
        made_in["world_parts"],
        tolerance_of(meta),
    )


def _own(name: str, source: Any) -> Entrant:
    """Give a policy of the user's own. Raises UserError: nothing that acts, or that observes what there is."""
    target = own.made(source)
    mode, task = own.observes(target, name)
    path, action = own.origin(source), own.acts(source, target)
    digest_of = digest(path) if path is not None else f"object:{uuid.uuid4().hex}"
    if path is not None and split(source)[1] is not None:  # acts otherwise, so it is another policy
        digest_of = hashlib.sha256(f"{digest_of} {action}".encode()).hexdigest()
    kept = source if isinstance(source, str) else target
    where, known = Path(name) if path is None else path, own.made_in(target)
    hashes, made_of = tuple(known["world_hashes"]), known["world_parts"]
    how: Any = {"alone": own.plays_alone(target), "measured": action not in (None, OFFSET)}
    how["measured"] |= bool(getattr(target, "measured", False))
    return Entrant(name, where, mode, 0, hashes, task, digest_of, made_of, source=kept, **how)


def given(policies: Policies) -> list[tuple[str, Any]]:
    """Name and policy of each that was given: a text or path, an object, a mapping of names, or a sequence of these."""
    if isinstance(policies, Mapping):
        return [(str(name), policy) for name, policy in policies.items()]
    if isinstance(policies, Path):
        return [("", str(policies))]
    if isinstance(policies, Sequence) and not isinstance(policies, str):
        return [pair for one in policies for pair in given(one)]
    return [("", policies)]


def entrants(policies: Policies) -> list[Entrant]:
    """All of them.

    Raises:
        UserError: none given; no policy; two of one name and training seed.
    """
    pairs = given(policies)
    if not pairs:
        raise UserError("no policy given", expected="a policy's folder, or NAME=FOLDER")
    chosen = []
    for name, policy in pairs:
        if isinstance(policy, str | Path):
            chosen.append(entrant(f"{name}={policy}" if name else str(policy)))
        else:
            usual = getattr(policy, "__name__", type(policy).__name__)
            chosen.append(_own(name or (usual if usual.isidentifier() else "policy"), policy))
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
    """Refuses policies that know the world whose unseen success shall be measured.

    They do if they were trained or fine-tuned in it, or in one that shares a part with it which training worlds do not
    have: V and VNP share looks, P and VNP a plant.

    Args:
        who: the policies.
        world, world_hash: the target's name and hash.
        source: the target's file; by default the built-in world of that name.
        training: the comparison's training world, whose parts are held out from nobody, as those of S are.

    Raises:
        UserError: one does; the part is named.
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
    """Give the folder's name; of a run's checkpoint (runs/TASK/TIME_sSEED/checkpoints/best) the task's.

    Of one that was kept on the way (checkpoints/steps-8000), the task's and the steps: `LABEL-depth@8000`.
    """
    place = path.resolve()
    if match := re.fullmatch(r"(?:steps|updates)-(\d+)", place.name):
        return f"{_stem(place.parent)}@{match[1]}"
    while place.name in ("best", "last", "checkpoints") or re.match(r"\d{8}-\d{4}", place.name):
        place = place.parent
    return place.name or path.resolve().name
