"""Success of policies in one world: by training seed, pooled, and against each other on the same episodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from vispeg.evaluation.modalities import compare
from vispeg.evaluation.records import Episode
from vispeg.evaluation.statistics.crossed import rate
from vispeg.evaluation.statistics.intervals import wilson
from vispeg.evaluation.table import Cell, Table


def success_table(episodes: Iterable[Episode], world: str) -> dict[str, Any]:
    """What a transfer table of one world shows, ready for JSON.

    Returns:
        {world, hash, rows, comparisons}. A row is {policy, by_seed: {training seed: Wilson}, pooled: Wilson over all
        episodes, recipe: interval over training seeds and episodes at once, categories}; an interval is {value, low,
        high, n}. A comparison is {first, second, difference, p, p_holm, verdict}: McNemar's exact test on the same
        training seeds and episodes, Holm's correction over all pairs of policies.

    Raises:
        UserError: no episode, or none in common.
    """
    table = Table(e for e in episodes if e.world == world)
    rows = []
    for policy in table.policies:
        cell = Cell(policy, world)
        outcomes, every = table.outcomes(cell), table.all(cell)
        seeds = table.train_seeds([cell])
        row: dict[str, Any] = {"policy": policy}
        row["by_seed"] = {t: wilson(int(y.sum()), len(y)).to_json() for t, y in zip(seeds, outcomes, strict=True)}
        row["pooled"] = wilson(int(outcomes.sum()), outcomes.size).to_json()
        row["recipe"] = rate(outcomes).to_json()
        row["categories"] = dict(Counter(e.category for e in every).most_common())
        row["peak_force"] = sum(e.peak_force for e in every) / len(every)
        rows.append(row)
    comparisons = [
        {
            "first": c.first,
            "second": c.second,
            "difference": c.difference.to_json(),
            "p": c.p,
            "p_holm": c.p_holm,
            "verdict": c.verdict,
        }
        for c in compare(table, world, table.policies)
    ]
    return {"world": world, "hash": table.hashes[world], "rows": rows, "comparisons": comparisons}


def markdown(table: Mapping[str, Any]) -> str:
    """The two tables as Markdown: rates with 95 % intervals in percent, differences in points."""
    seeds = sorted({int(t) for row in table["rows"] for t in row["by_seed"]})
    heads = ["policy", *(f"seed {t}" for t in seeds), "pooled", "over seeds", "peak force, N", "failures"]
    lines = [_line(heads), _line(["---"] * len(heads))]
    for row in table["rows"]:
        by = {int(t): e for t, e in row["by_seed"].items()}
        failed = ", ".join(f"{k} {n}" for k, n in row["categories"].items() if k != "success")
        cells = [row["policy"], *(_rate(by[t]) if t in by else "-" for t in seeds), _rate(row["pooled"])]
        lines.append(_line([*cells, _rate(row["recipe"]), f"{row['peak_force']:.0f}", failed or "none"]))
    if table["comparisons"]:
        heads = ["first - second", "points", "McNemar's p", "after Holm", "verdict"]
        lines += ["", _line(heads), _line(["---"] * len(heads))]
    for c in table["comparisons"]:
        d = c["difference"]
        points = f"{100 * d['value']:+.1f} ({100 * d['low']:+.1f} to {100 * d['high']:+.1f})"
        pair = f"{c['first']} - {c['second']}"
        lines.append(_line([pair, points, f"{c['p']:.2g}", f"{c['p_holm']:.2g}", c["verdict"]]))
    return "\n".join(lines) + "\n"


def _rate(e: Mapping[str, Any]) -> str:
    return f"{100 * e['value']:.1f} % ({100 * e['low']:.1f} to {100 * e['high']:.1f})"


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
