"""The outcome of a measurement protocol: numbers, notes and tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vispeg.worlds.measurement_file import Quantity


@dataclass(frozen=True)
class Outcome:
    """Results of one protocol.

    Attributes:
        results: the numbers, the main one first.
        notes: limitations of the results, one per text.
        details: tables for the measurement file.
    """

    results: tuple[Quantity, ...]
    notes: tuple[str, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict)


def by_place(values: np.ndarray, place: np.ndarray | None) -> Mapping[str, object]:
    """Return the mean, spread and number of readings at each place, for the file's `details`."""
    if place is None:
        return {}
    rows = []
    for p in np.unique(place):
        v = values[place == p]
        sd = float(v.std(ddof=1)) if len(v) > 1 else None
        rows.append({"place": float(p), "mean": float(v.mean()), "sd": sd, "repeats": len(v)})
    return {"places": rows}


def short(count: int, wanted: int, thing: str, lacking: str = "") -> list[str]:
    """Word a note if there are fewer of a thing (named in the singular) than the protocol requires.

    Args:
        count, wanted: the number of things, and the number that the protocol asks for.
        thing: what is counted, in the singular.
        lacking: name of a column that the table lacks and that would distinguish several of the things; else "".
    """
    if count >= wanted:
        return []
    single = f"1 {thing}, as there is no column '{lacking}'" if lacking else f"1 {thing}"
    return [f"{single if count == 1 else f'{count} {thing}s'}; the protocol asks for {wanted}"]
