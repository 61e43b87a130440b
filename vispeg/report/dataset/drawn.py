"""Drawn parameters: a histogram of every one that varies, and the values of the constant ones."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from vispeg.core.effect import REGISTRY
from vispeg.report.text.effect_words import unit as unit_beside
from vispeg.report.text.quantities import plain, quantity

BINS, WIDTH, HEIGHT = 24, 168, 46  # bars of a histogram; its size, px


def drawn(worlds: Sequence[Mapping[str, Mapping[str, float]]]) -> Mapping[str, object]:
    """Return the template's values for the worlds drawn for each episode (label -> parameter -> value).

    Returns:
        `effects`: effect -> rows with `place`, `param`, `low`, `high`, `unit`, `svg`, and `share`, the share of
        episodes in words, empty for all. `fixed`: rows with `label`, `param`, `value` with its unit and `share`, of
        what has one value wherever it is drawn; values of absent effects are left out.
    """
    draws: dict[tuple[str, str], list[float]] = defaultdict(list)
    for world in worlds:
        for label, params in world.items():
            for name, value in params.items():
                draws[label, name].append(float(value))
    effects: dict[str, list[dict[str, str]]] = defaultdict(list)
    fixed = []
    for (label, name), values in sorted(draws.items()):
        kind, _, place = label.rstrip(")").partition("(")
        unit = _unit(kind, name)
        if name == "seed":  # a histogram of seeds says nothing
            continue
        share = len(values) / len(worlds)
        times = "" if share > 0.999 else f"in {100 * share:.0f} % of episodes"
        if max(values) - min(values) <= 1e-12 * max(1.0, abs(values[0])):
            if not _vanishes(kind, name, values[0]):
                fixed.append({"label": label, "param": name, "value": quantity(values[0], unit), "share": times})
            continue
        ends = {"low": plain(min(values)), "high": plain(max(values)), "unit": unit}
        effects[kind].append({"place": place, "param": name, "svg": histogram(values), "share": times, **ends})
    return {"effects": dict(effects), "fixed": fixed}


def histogram(values: Sequence[float], bins: int = BINS) -> str:
    """Return a histogram as SVG, from the lowest to the highest value, the tallest bar at full height."""
    counts, ends = np.histogram(values, bins=bins)
    tall, step = max(int(counts.max()), 1), WIDTH / bins
    bars = "".join(
        f'<rect x="{i * step:.1f}" y="{HEIGHT - h:.1f}" width="{step - 1:.1f}" height="{h:.1f}">'
        f"<title>{plain(ends[i])} to {plain(ends[i + 1])}: {n}</title></rect>"
        for i, n in enumerate(counts)
        if (h := n / tall * HEIGHT) > 0
    )
    return f'<svg viewBox="0 0 {WIDTH} {HEIGHT + 1}" role="img" aria-label="histogram">{bars}</svg>'


def _unit(kind: str, name: str) -> str:
    """Return the unit of an effect's parameter; empty if this version does not know it."""
    return unit_beside(REGISTRY[kind].params[name].unit) if kind in REGISTRY and name in REGISTRY[kind].params else ""


def _vanishes(kind: str, name: str, value: float) -> bool:
    """Return whether a parameter has the value of an absent effect."""
    param = REGISTRY[kind].params.get(name) if kind in REGISTRY else None
    return param is not None and value == param.absent
