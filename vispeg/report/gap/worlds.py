"""Descriptions of worlds, because names such as S, V, N, P and VNP say nothing to a newcomer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vispeg.core.errors import UserError
from vispeg.task.world_file import BUILT_IN, WORLD, load_world

SHORT = {"V": "unseen looks", "N": "unseen sensor", "P": "hidden physics"}  # short captions, for below bars


def caption(name: str, values: Mapping[str, Any]) -> str:
    """Return a caption for a world, such as `training world`, `unseen looks`, `all at once`, or empty."""
    if len(values["worlds"]) < 2:
        return ""
    if name == values["reference"] and home_of_all(name, values["policies"]):
        return "training world"
    if name == values["joint"]:
        return "all at once"
    return SHORT.get(name, "")


def home_of_all(world: str, policies: Sequence[Mapping[str, Any]]) -> bool:
    """Return whether all trained policies were trained in this world, according to their records."""
    trained = [p for p in policies if not p["scripted"]]
    return bool(trained) and all(world in (p["home"] or ()) for p in trained)


def about(values: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return the descriptions of the worlds from their files, only for unchanged built-in worlds."""
    entries = []
    for world in values["worlds"]:
        name = str(world["name"])
        if name.isidentifier() and (BUILT_IN / f"{name}.yaml").is_file():
            try:
                same = load_world(name).hash == world.get("hash")
            except UserError:
                same = False
            text = str(WORLD.read(BUILT_IN / f"{name}.yaml").get("about") or "") if same else ""
            entries += [{"name": name, "text": " ".join(text.split())}] if text else []
    return entries
