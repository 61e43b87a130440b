"""Write a changed world as a world file of its own, so that it has a hash and can be run again."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from vispeg.core.files import write_text_atomic
from vispeg.task.registry import scene_of
from vispeg.task.world_file import FORMAT, WorldFile, load_world

HELD = "held"  # stands for the place of the part that the gripper of the world's cell holds


@dataclass(frozen=True)
class Change:
    """An effect set to values.

    Attributes:
        effect: the effect's name.
        params: parameter -> number or distribution, as in a world file.
        where: the effect's place; HELD for the part that the gripper holds; "*" for the places that the effect has in
            the base world, or all places if it has none there.
    """

    effect: str
    params: Mapping[str, Any] = field(default_factory=dict)
    where: str = "*"


def overlay(
    base: str | Path, name: str, folder: Path, changes: Sequence[Change] = (), task: Mapping[str, Any] | None = None
) -> WorldFile:
    """Write a world file based on `base`, and load it. Without changes, load the base itself.

    The file's name ends with a hash of its content, as the names of two worlds may differ only in characters that are
    replaced by `_` in it.

    Args:
        base: file or built-in name of the world to change.
        name: name of the changed world; its file's name begins with it.
        folder: for the file.
        changes: effects to set.
        task: task settings to replace.

    Raises:
        UserError: as `load_world`: unknown effects, places, parameters or task keys, or values out of bounds.
    """
    world = load_world(base)
    if not changes and not task:
        return world
    entries, held = [], scene_of({**world.task, **(task or {})}).held
    for change in changes:
        if change.where == "*":
            places = [r.where for r in world.world.ranges if r.effect == change.effect] or ["all"]
        else:
            places = [held if change.where == HELD else change.where]
        for where in places:
            entries.append({"effect": change.effect, "where": where, "params": dict(change.params)})
    head = {"format": FORMAT, "name": name, "base": str(world.path.resolve())}
    data = {**head, "task": dict(task or {}), "effects": entries}
    text = yaml.safe_dump(data, sort_keys=False)
    slug, digest = re.sub(r"[^\w.+-]+", "_", name), hashlib.sha256(text.encode()).hexdigest()
    path = write_text_atomic(folder / f"{slug}-{digest[:12]}.yaml", text, overwrite=True)
    return load_world(path)
