"""Success of policies in one world: by training seed, pooled, and against each other on the same episodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from vispeg.evaluation.records import Episode
from vispeg.evaluation.statistics import decide, difference, rate, wilson
from vispeg.evaluation.table import Cell, Table


def success_table(episodes: Iterable[Episode], world: str) -> dict[str, Any]:
    """Return what a transfer table of one world shows, ready for JSON.

    Returns:
        {world, hash, rows, comparisons}. A row is {policy, by_seed: {training seed: Wilson}, pooled: Wilson over all
        episodes, recipe: interval over training seeds and episodes at once, categories}; an interval is {value, low,
        high, n}. A comparison is {first, second, difference, p, p_holm, verdict}, decided over all pairs of policies
        as `vispeg.evaluation.statistics` does.

    Raises:
        UserError: no episode, or none in common.
    """
    table = Table(e for e in episodes if e.world == world)
    rows = []
    for policy in table.policies:
        cell = Cell(policy, world)
        outcomes, every = table.rows(cell), table.all(cell)
        row: dict[str, Any] = {"policy": policy}
        row["by_seed"] = {t: wilson(int(sum(y.values())), len(y)).to_json() for t, y in outcomes.items()}
        row["pooled"] = wilson(sum(e.success for e in every), len(every)).to_json()
        row["recipe"] = rate(outcomes).to_json()
        row["categories"] = dict(Counter(e.category for e in every).most_common())
        row["peak_force"] = sum(e.peak_force for e in every) / len(every)
        rows.append(row)
    pairs = [(a, b) for i, a in enumerate(table.policies) for b in table.policies[i + 1 :]]
    sides = {p: table.rows(Cell(p, world)) for p in table.policies}
    decided = decide({(a, b): difference(sides[a], sides[b], same_networks=False) for a, b in pairs})
    comparisons = [
        {
            "first": a,
            "second": b,
            "difference": d.estimate.to_json(),
            "p": d.test.p,
            "p_holm": d.p_holm,
            "verdict": d.verdict,
        }
        for (a, b), d in decided.items()
    ]
    return {"world": world, "hash": table.hashes[world], "rows": rows, "comparisons": comparisons}


def markdown(table: Mapping[str, Any]) -> str:
    """Return the two tables as Markdown: rates with 95 % intervals in percent, differences in points."""
    seeds = sorted({int(t) for row in table["rows"] for t in row["by_seed"]})
    heads = ["policy", *(f"seed {t}" for t in seeds), "pooled", "over seeds", "peak force, N", "failures"]
    lines = [_line(heads), _line(["---"] * len(heads))]
    for row in table["rows"]:
        by = {int(t): e for t, e in row["by_seed"].items()}
        failed = ", ".join(f"{k} {n}" for k, n in row["categories"].items() if k != "success")
        cells = [row["policy"], *(_rate(by[t]) if t in by else "-" for t in seeds), _rate(row["pooled"])]
        lines.append(_line([*cells, _rate(row["recipe"]), f"{row['peak_force']:.0f}", failed or "none"]))
    if table["comparisons"]:
        heads = ["first - second", "points", "p", "after Holm", "verdict"]
        lines += ["", _line(heads), _line(["---"] * len(heads))]
    for c in table["comparisons"]:
        d = c["difference"]
        points = f"{100 * d['value']:+.1f} ({100 * d['low']:+.1f} to {100 * d['high']:+.1f})"
        pair = f"{c['first']} - {c['second']}"
        lines.append(_line([pair, points, *(_p(c[k]) for k in ("p", "p_holm")), c["verdict"]]))
    return "\n".join(lines) + "\n"


def _rate(e: Mapping[str, Any]) -> str:
    return f"{100 * e['value']:.1f} % ({100 * e['low']:.1f} to {100 * e['high']:.1f})"


def _p(p: float | None) -> str:
    return "-" if p is None else f"{p:.2g}"


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
