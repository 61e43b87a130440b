"""Worlds in words, where a page first names them: S, V, N, P and VNP say nothing to a newcomer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vispeg.core.errors import UserError
from vispeg.task.world_file import BUILT_IN, WORLD, load_world

SHORT = {"V": "unseen looks", "N": "unseen sensor", "P": "hidden physics"}  # below bars, where little room is


def caption(name: str, values: Mapping[str, Any]) -> str:
    """Give a few words below a world's name: `training world`, `unseen looks`, `all of them`; empty where there are
    none.
    """
    if len(values["worlds"]) < 2:
        return ""
    if name == values["reference"] and home_of_all(name, values["policies"]):
        return "training world"
    if name == values["joint"]:
        return "all at once"
    return SHORT.get(name, "")


def home_of_all(world: str, policies: Sequence[Mapping[str, Any]]) -> bool:
    """Tell whether all policies that were trained were trained there, as far as their records tell."""
    trained = [p for p in policies if not p["scripted"]]
    return bool(trained) and all(world in (p["home"] or ()) for p in trained)


def about(values: Mapping[str, Any]) -> list[dict[str, str]]:
    """Give what each world is, in its own file's words; of those alone that are the built-in ones."""
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
