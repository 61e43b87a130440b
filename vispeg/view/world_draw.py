"""Draw an episode's start in a world, in a worker process: the cell, its values, and pictures by its cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
import yaml

from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.render.image_kinds import kind_of, picture_of
from vispeg.report.text import effect_words
from vispeg.sim.compiled import compiled
from vispeg.task.environments.vector import TaskVec
from vispeg.task.world_file import FORMAT, files, load_world
from vispeg.worlds.distribution import LogUniform, Uniform
from vispeg.worlds.entry import entry_dict
from vispeg.worlds.places import MANY


@dataclass(frozen=True)
class Range:
    """A range of a world's parameter that the page can change.

    Attributes:
        effect, where, param: the effect, its place and its parameter.
        unit: unit of the values.
        low, high: the range in the world.
        least, most: the bounds of the slider.
    """

    effect: str
    where: str
    param: str
    unit: str
    low: float
    high: float
    least: float
    most: float


Moved = Mapping[tuple[str, str, str], tuple[float, float]]  # effect, place, parameter -> ends of its moved range


@dataclass(frozen=True)
class Drawn:
    """An episode's start: compiled cell, configuration, poses of bodies, pictures (H, W, 3) uint8, and drawn values."""

    model: mujoco.MjModel
    qpos: np.ndarray
    bodies: dict[str, np.ndarray]
    pictures: dict[str, np.ndarray]
    values: list[tuple[str, str]]


class Draws:
    """The object of the page's worker; `tell` gets "ranges" (list of Range) and "drawn" (Drawn)."""

    def __init__(self, tell: Callable[[str, Any], None]):
        self.tell = tell

    def open(self, world: str) -> None:
        """Send the ranges of a world. Raises UserError: no such world."""
        self.tell("ranges", ranges(world))

    def draw(self, world: str, seed: int, moved: Moved) -> None:
        """Draw and send an episode's start in a world with moved ranges.

        Raises:
            UserError: no such world, or an impossible one.
        """
        self.tell("say", "drawing")
        with TemporaryDirectory() as folder:
            if moved:
                world = str(write_text_atomic(Path(folder) / "world.yaml", changed_text(world, "drawn", moved)))
            env = TaskVec(1, world, obs_mode="rgbd", render_mode="rgb_array")
        try:
            obs, _ = env.reset(seed=[seed])
            snapshot, values = env.sim.snapshot(0), env.drawn(0).values
            outside = env.render()
            pictures = {"from outside": outside[0]} if outside is not None else {}
            pictures |= {key: picture_of(key, value[0]) for key, value in obs.items() if kind_of(key) is not None}
            drawn = [in_words(label, params) for label, params in values.items()]
            bodies = {name: np.asarray(place) for name, place in snapshot.bodies.items()}
            self.tell("drawn", Drawn(compiled(env.sim.scene), snapshot.qpos, bodies, pictures, drawn))
        finally:
            env.close()

    def save(self, file: Path, world: str, moved: Moved, overwrite: bool = False) -> str:
        """Write a world with moved ranges to a file, whose name it takes; return the path.

        Raises:
            UserError: no such world, it is this file or based on it, or the file exists and `overwrite` is false.
        """
        if file.resolve() in files(world):
            raise UserError("the world is based on this file", file=file, expected="another name")
        write_text_atomic(file, changed_text(world, file.stem, moved), overwrite=overwrite)
        return str(load_world(file).path)


def changed_text(world: str, name: str, moved: Moved) -> str:
    """Return the text of a world file with a world as its base, whose ranges are moved.

    A range of many places removes those that a base has for its effect, so all of that effect are written beside it.

    Raises:
        UserError: no such world.
    """
    opened = load_world(world)
    base = str(opened.path.resolve()) if Path(world).suffix else world
    broad = {name for name, where, _ in moved if where in MANY}
    entries = []
    for entry in opened.world.ranges:
        params: dict[str, Any] = dict(entry.params)
        for param, old in entry.params.items():
            if (ends := moved.get((entry.effect, entry.where, param))) is not None:
                params[param] = (LogUniform if isinstance(old, LogUniform) else Uniform)(*ends)
        if params != dict(entry.params):
            entry = replace(entry, params=params, source="chosen on the page")
        elif entry.effect not in broad:
            continue
        entries.append(entry_dict(entry))
    return yaml.safe_dump({"format": FORMAT, "name": name, "base": [base], "effects": entries}, sort_keys=False)


def in_words(label: str, values: Mapping[str, float]) -> tuple[str, str]:
    """Return an effect's name and drawn values in words, such as `Link mass of link 1`, `mass 0.287 kg`."""
    name, _, where = label.removesuffix(")").partition("(")
    params = effect(name).params
    texts = {k: effect_words.in_unit({"value": v, "unit": params[k].unit}) for k, v in values.items()}
    title = effect_words.named({"effect": name, "where": where})
    return title, ", ".join(f"{k.replace('_', ' ')} {text}" for k, text in texts.items())


def ranges(world: str) -> list[Range]:
    """Return the uniform and log-uniform ranges of a world, each with slider bounds that its effect allows."""
    entries = []
    for entry in load_world(world).world.ranges:
        for name, value in entry.params.items():
            param = effect(entry.effect).params[name]
            match value:
                case Uniform(low, high) if high > low:
                    span = high - low
                    ends = max(low - span, param.low), min(high + span, param.high)
                case LogUniform(low, high) if high > low:
                    ends = max(low / 3, param.low), min(high * 3, param.high)
                case _:
                    continue
            entries.append(Range(entry.effect, entry.where, name, param.unit, low, high, *ends))
    return entries
