"""Two ways to train, compared over several plants: the plants are the sample, each a pair."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
from scipy import stats

HARD = 0.8  # success of the second way below which a plant is a hard one


def compared(tables: Sequence[Mapping[str, Any]], first: str, second: str) -> dict[str, Any]:
    """Return the success of `first` less that of `second` over plants.

    Args:
        tables: a `success_table` of each plant.
        first, second: policies of every table.

    Returns:
        {first, second, plants: [{world, first, second, difference}], over_plants, hard}: `over_plants` and `hard` (the
        plants where `second` succeeds in less than HARD) are {value, low, high, n, p}, with Student's interval of the
        mean over plants and the exact p of flipping each plant's sign; bounds and p are None below two plants.
        `no_worse` counts the plants whose interval lies above -5 points, `better` those whose verdict is so.
    """
    rows, verdicts = [], []
    for table in tables:
        rate = {row["policy"]: row["pooled"]["value"] for row in table["rows"]}
        rows.append({"world": table["world"], "first": rate[first], "second": rate[second]})
        rows[-1]["difference"] = rate[first] - rate[second]
        verdicts.append(_verdict(table, first, second))
    hard = [row["difference"] for row in rows if row["second"] < HARD]
    return {
        "first": first,
        "second": second,
        "plants": rows,
        "over_plants": mean_difference([row["difference"] for row in rows]),
        "hard": mean_difference(hard),
        "no_worse": sum(low > -0.05 for low, _ in verdicts),
        "better": sum(better for _, better in verdicts),
    }


def mean_difference(differences: Sequence[float]) -> dict[str, Any]:
    """Return {value, low, high, n, p} of the mean over plants; the exact sign-flip test is Fisher's (1935)."""
    d = np.asarray(differences, float)
    if d.size < 2:
        return {"value": float(d[0]) if d.size else None, "low": None, "high": None, "n": int(d.size), "p": None}
    half = float(stats.t.ppf(0.975, d.size - 1) * d.std(ddof=1) / np.sqrt(d.size))
    signs = np.array(list(product((-1.0, 1.0), repeat=d.size)))
    p = float(np.mean(np.abs(signs @ d) >= abs(d.sum()) - 1e-12))
    return {
        "value": float(d.mean()),
        "low": float(d.mean()) - half,
        "high": float(d.mean()) + half,
        "n": d.size,
        "p": p,
    }


def markdown(found: Mapping[str, Any]) -> str:
    """Return the plants as rows, and the mean below them."""
    lines = [f"| plant | {found['first']} | {found['second']} | difference, points |", "| --- | --- | --- | --- |"]
    for row in found["plants"]:
        cells = [f"{100 * row[key]:.1f} %" for key in ("first", "second")]
        lines.append(f"| {row['world']} | {' | '.join(cells)} | {100 * row['difference']:+.1f} |")
    said = [f"over plants: {_words(found['over_plants'])}", f"hard ones: {_words(found['hard'])}"]
    said += [f"no worse beyond doubt (5 points) in {found['no_worse']}, better in {found['better']}"]
    return "\n".join([*lines, "", "; ".join(said) + "."]) + "\n"


def _verdict(table: Mapping[str, Any], first: str, second: str) -> tuple[float, bool]:
    """Return the lower bound of first less second in a plant, and whether first is better by the project's rule."""
    for c in table["comparisons"]:
        d, different = c["difference"], c["verdict"] == "different"
        if (c["first"], c["second"]) == (first, second):
            return d["low"], different and d["value"] > 0
        if (c["first"], c["second"]) == (second, first):
            return -d["high"], different and d["value"] < 0
    raise ValueError(f"{first} and {second} are not compared")


def _words(mean: Mapping[str, Any]) -> str:
    if mean["value"] is None:
        return "none"
    text = f"{100 * mean['value']:+.1f} points, {mean['n']} plants"
    return (
        text
        if mean["p"] is None
        else f"{text} ({100 * mean['low']:+.1f} to {100 * mean['high']:+.1f}, p {mean['p']:.2g})"
    )
