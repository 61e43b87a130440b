"""Lists of named things: effects, robots, worlds, policies and motions."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass

from vispeg.core.effect import Effect, Family, effect, searchable
from vispeg.effects import find
from vispeg.identify.excitation import MOTIONS, osc_targets
from vispeg.identify.motions.look_motion import ABOUT
from vispeg.robots import menagerie
from vispeg.robots.model import RobotModel, load
from vispeg.robots.scene import Scene, build
from vispeg.task.registry import FIRST, kind_of, task
from vispeg.task.rig.expert import EXPERT
from vispeg.task.world_file import WORLD, by_name, load_world


@dataclass(frozen=True)
class Entry:
    """A named thing: name, family, one sentence on what it is, and further data for JSON."""

    name: str
    family: str
    about: str
    more: Mapping[str, object]

    @property
    def record(self) -> dict[str, object]:
        """The entry as plain data, for JSON."""
        return {"name": self.name, "family": self.family, "about": self.about, **self.more}


def effects(
    name: str | None = None, search: str = "", family: Family | None = None, robot: str = "iiwa14"
) -> list[tuple[Effect, RobotModel | Scene]]:
    """Return effects, each with the robot or the default cell whose joints, links or parts are its places.

    Args:
        name: the effect to explain; default: list all.
        search: only effects with this text in name, description or parameters.
        family: only effects of this family.
        robot: a robot's name or a path to an MJCF or URDF; its joints and links are the places.

    Raises:
        UserError: no such effect or robot.
    """
    chosen = [effect(name)] if name else find(search, family)
    arm, scene, on_arms = load(robot), build(), searchable()
    return [(kind, arm if kind.name in on_arms else scene) for kind in chosen]


def robots() -> list[Entry]:
    """Return the arms that have a name; the family says whether one is installed, or is downloaded when used."""
    entries = [Entry("iiwa14", "built in", "KUKA LBR iiwa 14 R820", {"model": "built in"})]
    for name, (entry, title) in menagerie.ARMS.items():
        entries.append(Entry(name, menagerie.state(name), title, {"model": entry}))
    listed = {entry.partition("/")[0] for entry in menagerie.SHORT.values()}  # folders of arms with a short name
    own = [Entry(name, menagerie.HERE, "A folder of MENAGERIE_ROOT", {"model": name}) for name in menagerie.folders()]
    return sorted([*entries, *(e for e in own if e.name not in listed)], key=lambda e: e.name)


def worlds() -> list[Entry]:
    """Return the built-in worlds; the family is `fixed`, or `randomized` if values are drawn for each episode."""
    entries = []
    for name, file in by_name().items():
        data = WORLD.read(file)
        bases = data.get("base") or []
        bases = [bases] if isinstance(bases, str) else list(bases)
        family = "randomized" if bases or data.get("effects") or data.get("model") else "fixed"
        entries.append(Entry(name, family, _sentence(str(data.get("about", ""))), {"base": bases}))
    return entries


def policies() -> list[Entry]:
    """Return the bundled policies; the family is the modality."""
    from vispeg.learn.meta import made_for  # here, as the other lists need nothing of the extra `learn`
    from vispeg.learn.record import PAIR, read_record
    from vispeg.learn.shipped import names, policy_folder

    entries, built_in = [], by_name()
    for name in names():
        record = read_record(policy_folder(name))
        meta = record["meta"]
        success, settings = meta.get("success"), made_for(meta)
        kind = "two policies in one" if record["format"] == PAIR.name else "one network"
        world = meta.get("world", "?")
        world_hash = load_world(world).hash if world in built_in else None
        changed = world_hash is not None and meta.get("world_hash", world_hash) != world_hash
        parts = [f"trained in {world}{' as it was before' * changed}", kind]
        if (tolerance := kind_of(meta.get("task") or {}).tolerance) is not None and settings:
            parts.append(f"{settings[tolerance.setting]:g} {tolerance.unit} {tolerance.name}")
        parts += [f"{100 * success:.0f} % success there"] if success is not None else []
        more = {"world": meta.get("world"), **settings, "success": success, "steps": meta.get("steps")}
        entries.append(Entry(name, str(record["modality"]), ", ".join(parts), more))
    return entries


def motions() -> list[Entry]:
    """Return the motions of `vispeg record --motion`; the family is the space in which a motion is defined."""
    entries = [Entry(name, "joint", _sentence(inspect.getdoc(f) or ""), {}) for name, f in MOTIONS.items()]
    looks = [Entry(name, "cell", about, {}) for name, about in ABOUT.items()]
    entries.append(Entry("osc", "cartesian", _sentence(inspect.getdoc(osc_targets) or ""), {}))
    entries += [
        Entry(name, "contact", _sentence(inspect.getdoc(f) or ""), {}) for name, f in task(FIRST).motions.items()
    ]
    return [*entries, Entry(EXPERT, "contact", "A whole insertion by the task's scripted policy", {}), *looks]


def search(entries: list[Entry], text: str = "", family: str | None = None) -> list[Entry]:
    """Return the entries of a family (None for all) that contain a text, ignoring case."""
    word = text.lower()
    return [e for e in entries if family in (None, e.family) and word in f"{e.name} {e.family} {e.about}".lower()]


def _sentence(text: str) -> str:
    """Return the first sentence of a text."""
    return " ".join(text.partition("\n\n")[0].split()).partition(". ")[0].rstrip(".")
