"""Who is evaluated: a policy's folder with the name, modality and training seed under which its episodes stand."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vispeg.core.assets import assets
from vispeg.core.errors import UserError
from vispeg.core.provenance import digest

META = "policy.json"
EXPERT = "expert"  # the scripted policy of vispeg.task.expert takes part under this name
INTERFACE = ("stack", "dof", "offset", "turn", "policy_period")  # of the task: what a policy was made for, in any world


@dataclass(frozen=True)
class Entrant:
    """A policy that takes part.

    Attributes:
        name: in tables; replicas that differ in `train_seed` only share it.
        path: of its folder.
        modality: what it observes.
        train_seed: of its training.
        trained_on: hashes of the worlds it was trained or fine-tuned in.
        task: the part of the task that it was made for (stack, dof, ...).
        digest: SHA-256 of its folder.
    """

    name: str
    path: Path
    modality: str
    train_seed: int
    trained_on: tuple[str, ...]
    task: dict[str, Any]
    digest: str


def entrant(text: str) -> Entrant:
    """`FOLDER`, `NAME=FOLDER`, or `expert` (the scripted policy). A folder that is not there may be a shipped policy.

    Without NAME, the folder's name counts, less a training seed at its end (`depth_s2` -> `depth`); of a checkpoint in
    a run's folder, the task's.

    Raises:
        UserError: no such policy, a folder without a readable policy.json.
    """
    name, _, place = text.rpartition("=")
    path = Path(place).expanduser()
    if place == EXPERT:
        return Entrant(name or EXPERT, Path(EXPERT), "state", 0, (), {}, EXPERT)
    if not path.exists():
        shipped = assets() / "policies"
        path = shipped / place
        if not path.is_dir():
            known = sorted(p.parent.name for p in shipped.glob(f"*/{META}"))
            raise UserError("no such policy", got=place, expected="a policy's folder", choices=[EXPERT, *known])
    record = _record(path / META)
    meta = record.get("meta") or {}
    seed = meta.get("seed", 0)
    seed = seed if isinstance(seed, int) else 0
    stem = _stem(path)
    hashes = [meta.get("world_hash"), *(meta.get("world_hashes") or ())]
    return Entrant(
        name or re.sub(rf"[-_.]?s(eed)?{seed}$", "", stem) or stem,
        path,
        str(record.get("modality", "")),
        seed,
        tuple(dict.fromkeys(str(h) for h in hashes if h)),
        {k: v for k, v in (meta.get("task") or {}).items() if k in INTERFACE},
        digest(path),
    )


def entrants(texts: Sequence[str]) -> list[Entrant]:
    """All of them.

    Raises:
        UserError: none given; two of one name and training seed.
    """
    if not texts:
        raise UserError("no policy given", expected="a policy's folder, or NAME=FOLDER")
    found = [entrant(text) for text in texts]
    seen: dict[tuple[str, int], Entrant] = {}
    for e in found:
        other = seen.setdefault((e.name, e.train_seed), e)
        if other is not e:
            raise UserError(
                f"two policies called {e.name} with training seed {e.train_seed}",
                expected="NAME=FOLDER",
                got=f"{other.path}, {e.path}",
            )
    return found


def refuse_trained_on(who: Iterable[Entrant], world: str, world_hash: str) -> None:
    """Raises UserError for a policy that was trained in the world whose unseen success shall be measured."""
    for e in who:
        if world_hash and world_hash in e.trained_on:
            raise UserError(
                f"{e.name} was trained in {world}, so its success there is no transfer",
                file=e.path,
                expected="another target, or --fine-tuned",
                got=world_hash[:12],
            )


def _stem(path: Path) -> str:
    """The folder's name; of a run's checkpoint (runs/TASK/TIME_sSEED/checkpoints/best) the task's."""
    place = path.resolve()
    while place.name in ("best", "last", "checkpoints") or re.match(r"\d{8}-\d{4}", place.name):
        place = place.parent
    return place.name or path.resolve().name


def _record(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError("not a policy's folder", file=path, got=error.strerror) from error
    except ValueError:
        raise UserError("is not JSON", file=path) from None
    if not isinstance(record, dict) or not isinstance(record.get("meta") or {}, dict):
        raise UserError("not a policy", file=path, expected="an object")
    return record
