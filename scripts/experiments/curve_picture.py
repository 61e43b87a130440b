"""Draws learning curves: the mean over seeds, a band from the worst to the best, against steps and wall clock."""

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


def draw(variants: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Writes the picture of what `fig3.described` gave for each variant."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 3.8), dpi=130, sharey=True)
    for variant in variants:
        colour, words = STYLES[variant["name"]]
        curve = variant["curve"]
        mean, low, high = ([100 * y for y in curve[k]] for k in ("mean", "low", "high"))
        label = f"{words} ({curve['seeds']} seed{'s' * (curve['seeds'] > 1)})"
        for axes, x in ((left, [s / 1000 for s in curve["steps"]]), (right, [s / 60 for s in curve["seconds"]])):
            axes.plot(x, mean, color=colour, lw=1.8, marker="o", ms=3, label=label)
            axes.fill_between(x, low, high, color=colour, alpha=0.18, lw=0)
    left.set_xlabel("environment steps, thousands")
    right.set_xlabel("wall clock, min")
    left.set_ylabel("success, %")
    left.set_ylim(-2, 102)
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
