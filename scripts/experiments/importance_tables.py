"""Tables of the value of each factor of randomization: points of success, and error of the believed goal."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from vispeg.evaluation.statistics import ALPHA, contrast

ALL, NOTHING = "everything", "nothing"


def lost(table: Mapping[str, Any], modality: str) -> list[dict[str, Any]]:
    """Return what each factor's absence costs in one world: paired differences to the policy with everything, worst
    first.

    Args:
        table: of `success_table`; its policies are called MODALITY-everything, MODALITY-no-FACTOR, MODALITY-nothing.
        modality: whose policies.
    """
    whole, out = f"{modality}-{ALL}", []
    for c in table["comparisons"]:
        if whole not in (c["first"], c["second"]):
            continue
        sign = 1.0 if c["first"] == whole else -1.0
        factor = factor_left(c["second"] if sign > 0 else c["first"], modality)
        if factor:
            d = c["difference"]
            low, high = sorted((sign * d["low"], sign * d["high"]))
            out.append({"factor": factor, "costs": sign * d["value"], "low": low, "high": high, "p": c["p"]})
    return sorted(out, key=lambda row: -row["costs"])


def factor_left(policy: str, modality: str) -> str:
    """Return the factor left out: `lights` of `depth-no-lights`, `all of them` of `depth-nothing`; else ""."""
    if policy == f"{modality}-{NOTHING}":
        return "all of them"
    return policy.removeprefix(f"{modality}-no-") if policy.startswith(f"{modality}-no-") else ""


def farther(errors: Mapping[str, np.ndarray], modality: str) -> list[dict[str, Any]]:
    """Return how much farther off a policy trained without a factor believes the goal to be, worst first.

    Args:
        errors: policy -> (training seeds, rows) lateral error in mm, the same rows for all.
        modality: whose policies.

    Returns:
        {factor, costs, low, high} in mm: differences of means with 95 % t intervals over training seeds and rows.
    """
    whole, out = errors.get(f"{modality}-{ALL}"), []
    for policy, values in errors.items():
        factor = factor_left(policy, modality)
        if factor and whole is not None:
            costs = contrast(values, -whole)
            low, high = costs.interval(ALPHA)
            out.append({"factor": factor, "costs": costs.value, "low": low, "high": high})
    return sorted(out, key=lambda row: -row["costs"])


def order(columns: Mapping[str, Sequence[Mapping[str, Any]]], rows: Sequence[str], said: Callable[[float], str]) -> str:
    """Return Markdown: a row a factor, a column of costs with their intervals; `-` where a policy is not trained yet.

    Args:
        columns: title -> rows of `lost` or `farther`.
        rows: factors, in the order of the table.
        said: a number as the table has it.
    """
    lines = ["| " + " | ".join(["left out", *columns]) + " |", "|" + "---|" * (1 + len(columns))]
    for factor in rows:
        cells = [factor]
        for column in columns.values():
            costs = [row for row in column if row["factor"] == factor]
            cells.append(" ".join([said(costs[0]["costs"]), _range(costs[0], said)]) if costs else "-")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _range(row: Mapping[str, Any], said: Callable[[float], str]) -> str:
    return f"({said(row['low'])} to {said(row['high'])})"


def points(share: float) -> str:
    """Word a share in points: 0.124 as +12."""
    return f"{100 * share:+.0f}"


def millimetres(value: float) -> str:
    """Word a length in mm: 1.234 as +1.2."""
    return f"{value:+.1f}"


def not_trained(missing: Mapping[int, Sequence[str]], of: int) -> str:
    """Word which policies the tables lack, in a sentence.

    Args:
        missing: by training seed, names of those that are not trained yet.
        of: policies of a seed.
    """
    parts = [
        f"seed {seed}: " + ("all" if len(names) == of else ", ".join(names)) for seed, names in missing.items() if names
    ]
    return "Not trained yet: " + ("; ".join(parts) or "none") + ".\n"
