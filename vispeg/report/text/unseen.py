"""Undetectable effects: for each effect not found, the size that it may have without being detected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vispeg.core.effect import REGISTRY
from vispeg.core.params import Param
from vispeg.report.record import rows
from vispeg.report.text.effect_words import named, unit
from vispeg.report.text.quantities import number, plain, prefix

SHOWN = 6  # effects shown unfolded on the page and listed in the terminal


@dataclass(frozen=True)
class Unseen:
    """An effect that was not found.

    Attributes:
        effect: its name in words.
        sizes: ranges of parameters that these recordings would not show: `x, y ±0.50 N; tx ±50 mN m`.
        share: largest hidden share of a parameter's range; 1 if a parameter would show at no size.
        never: whether none of its parameters would show at any size.
    """

    effect: str
    sizes: str
    share: float
    never: bool = False


def unseen(values: Mapping[str, Any]) -> list[Unseen]:
    """Return the effects not found, the least certain first; those that would show at no size come last."""
    found = {(e.get("effect"), e.get("where")) for e in rows(values, "effects")}
    out = []
    for row in rows(values, "shows_from"):
        between = row.get("between")
        if (row.get("effect"), row.get("where")) in found or not isinstance(between, dict) or not between:
            continue
        kind = REGISTRY.get(str(row.get("effect")))
        sizes: dict[str, list[str]] = {}
        shares = []
        for name, ends in between.items():
            words, share = _between(ends, kind.params.get(name) if kind is not None else None)
            sizes.setdefault(words, []).append(str(name).replace("_", " "))
            shares.append(share)
        texts = [f"{', '.join(names)} {words}" for words, names in sizes.items()]
        out.append(Unseen(named(row), "; ".join(texts), max(shares), min(shares) == 1.0))
    return sorted(out, key=lambda hidden: (hidden.never, -hidden.share))


def sentence(values: Mapping[str, Any], channel: str = "") -> str:
    """Return a sentence on the least certain effects, of one of several channels; empty if there are none."""
    hidden = unseen(values)
    if not hidden:
        return ""
    more = f"; {len(hidden) - SHOWN} more on the page" if len(hidden) > SHOWN else ""
    of = f"channel {channel}: " if channel else ""
    return f"{of}not detectable up to these sizes: {'; '.join(f'{h.effect} ({h.sizes})' for h in hidden[:SHOWN])}{more}"


def _between(between: Any, param: Param | None) -> tuple[str, float]:
    """Return hidden values as text, such as `±0.50 N` or `up to 20 µm/N`, and their share of the parameter's range."""
    ends = [number(v) for v in between] if isinstance(between, (list, tuple)) else []
    sizes = [end for end in ends if end is not None]
    if len(ends) != 2 or len(sizes) != 2:
        return "at any size", 1.0
    low, high = sizes
    factor, name = prefix(max(abs(low), abs(high)), unit(param.unit) if param is not None else "")
    if param is None:
        return f"{plain(low, 2)} to {plain(high, 2)}", 0.0
    near = 0.0 < high - low < low  # the interval is narrow, as for a factor near 1, so it needs more decimals
    decimals = max(0, -int(np.floor(np.log10(factor * (high - low))))) if near else 0
    texts = [f"{factor * v:.{decimals}f}" if near else plain(factor * v, 2) for v in (low, high)]
    if low == param.low == param.null:
        text = f"up to {texts[1]} {name}"
    elif high == param.high == param.null:
        text = f"down to {texts[0]} {name}"
    elif low == -high and param.null == 0:
        text = f"±{texts[1]} {name}"
    else:
        text = f"{texts[0]} to {texts[1]} {name}"
    scale = np.log if param.scale == "log" else float
    share = (scale(high) - scale(low)) / (scale(param.high) - scale(param.low)) if param.high > param.low else 0.0
    return text.strip(), min(float(share), 0.999)
