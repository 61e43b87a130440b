"""Sensors that come with the package: the camera effects of a type of depth camera, each range with its source.

Each is a world file (`vispeg-world/1`), so that a world can also name it as its `base`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.formats.yaml_data import read_yaml
from vispeg.worlds.entry import ranged_value
from vispeg.worlds.randomized import RandomizedEffect

PRESETS = Path(__file__).parent / "sensors"


def sensors() -> list[str]:
    """List the names of the sensors that come with the package."""
    return sorted(p.stem for p in PRESETS.glob("*.yaml"))


def sensor_file(name: str) -> Path:
    """Return the file of a sensor. Raises UserError, which lists the names: no such sensor."""
    if name not in sensors():
        raise UserError("unknown sensor", got=name, choices=sensors())
    return PRESETS / f"{name}.yaml"


def sensor(name: str, where: str | None = None) -> tuple[RandomizedEffect, ...]:
    """Return the ranges of a sensor, to add to those of a RandomizedWorld.

    Args:
        name: one of `sensors()`.
        where: a camera or `all`; None for the place that the file states.

    Raises:
        UserError: no such sensor.
    """
    path = sensor_file(name)
    entries = read_yaml(path)["effects"]
    return tuple(_ranged(entry, where, str(path), f"effects[{i}]") for i, entry in enumerate(entries))


def _ranged(entry: Mapping[str, Any], where: str | None, file: str, key: str) -> RandomizedEffect:
    """Read an entry of a sensor's file. Its place is not checked, as the cameras of the world are not known here.

    Args:
        entry: from YAML, with `effect`, `params`, `source` and perhaps `where`.
        where: a camera or `all`; None for the place that the entry states, or `all`.
        file, key: file and key of the entry, for errors.
    """
    kind = effect(entry["effect"], file=file, key=f"{key}.effect")
    params = {k: ranged_value(kind, k, v, file, f"{key}.params.{k}") for k, v in entry["params"].items()}
    return RandomizedEffect(entry["effect"], where or entry.get("where", "all"), params, source=entry["source"])


def noise_of(name: str) -> float:
    """Return the greatest scatter of a sensor's raw depth: k in 1/m, for a standard deviation of k z^2 at z m.

    It combines the upper ends of the ranges of two errors of disparity: `disparity_noise`, which is new in every frame,
    and `depth_temporal`, which lasts for some frames.

    Raises:
        UserError: no such sensor.
    """
    variance = 0.0
    for entry in read_yaml(sensor_file(name))["effects"]:
        p = entry["params"]
        if entry["effect"] in ("disparity_noise", "depth_temporal"):
            (ends,) = p["sd"].values()  # {distribution: [low, high]}, px
            variance += (float(ends[-1]) / (p["focal"] * p["baseline"])) ** 2
    return float(variance**0.5)
