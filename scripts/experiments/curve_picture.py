"""Draws learning curves, success and return: the mean over seeds, a band from the worst to the best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

STYLES = {
    "ff-nominal": ("#1f6fb4", "feed-forward, not randomized"),
    "ff-randomized": ("#d9822b", "feed-forward, randomized"),
    "lstm-nominal": ("#2a9d60", "LSTM, not randomized"),
    "lstm-randomized": ("#a23b72", "LSTM, randomized"),
}
COLOURS = tuple(colour for colour, _ in STYLES.values())


def draw(variants: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write the picture of variants {name, curve: see `curves.together`}, in the order of their colours.

    Runs of before have no returns; their picture has success alone, against steps and wall clock.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    returns = all("return" in variant["curve"] for variant in variants)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 3.8), dpi=130, sharey=not returns)
    for number, variant in enumerate(variants):
        colour, words = STYLES.get(variant["name"], (COLOURS[number % len(COLOURS)], variant["name"]))
        curve = variant["curve"]
        label = f"{words} ({curve['seeds']} seed{'s' * (curve['seeds'] > 1)})"
        success = {k: [100 * y for y in curve[k]] for k in ("mean", "low", "high")}
        steps, minutes = [s / 1000 for s in curve["steps"]], [s / 60 for s in curve["seconds"]]
        for axes, x, band in (
            (left, steps, success),
            (right, steps, curve["return"]) if returns else (right, minutes, success),
        ):
            axes.plot(x, band["mean"], color=colour, lw=1.8, marker="o", ms=3, label=label)
            axes.fill_between(x, band["low"], band["high"], color=colour, alpha=0.18, lw=0)
    left.set_xlabel("environment steps, thousands")
    left.set_ylabel("success, %")
    left.set_ylim(-2, 102)
    right.set_xlabel("environment steps, thousands" if returns else "wall clock, min")
    if returns:
        right.set_ylabel("return of an episode")
    for axes in (left, right):
        axes.set_xlim(left=0)
        axes.grid(alpha=0.3)
        axes.set_axisbelow(True)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    figure.legend(*left.get_legend_handles_labels(), ncols=2, loc="upper center", frameon=False, fontsize=9)
    figure.tight_layout(rect=(0, 0, 1, 0.88))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
    plt.close(figure)
