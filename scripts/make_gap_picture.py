"""Draws the README picture of a `vispeg gap` result: success of each policy in each world, with intervals.

python scripts/make_gap_picture.py docs/results/gap/gap.json docs/img/gap.png
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

COLOURS = {"state": "#555555", "depth": "#1f6fb4", "rgbd": "#2a9d60", "rgb": "#d9822b", "proprio": "#b0b0b0"}
WORDS = {
    "S": "S\ntraining world",
    "V": "V\nunseen looks,\nother renderer",
    "N": "N\nunseen sensor",
    "P": "P\nhidden physics",
    "VNP": "VNP\nall three",
}


def main(result: Path, picture: Path) -> None:
    """Bars with 95 % intervals, one group a world."""
    found = json.loads(result.read_text())
    rows = [r for r in found["success"] if not r["control"]]
    policies = sorted({(r["policy"], r["modality"]) for r in rows}, key=lambda p: (list(COLOURS).index(p[1]), p[0]))
    worlds = [w for w in WORDS if any(r["world"] == w for r in rows)]
    figure, axes = plt.subplots(figsize=(9, 3.6), dpi=130)
    width = 0.8 / len(policies)
    for i, (policy, modality) in enumerate(policies):
        hatch = "///" if any(m == modality for _, m in policies[:i]) else None  # another of the same modality
        for j, world in enumerate(worlds):
            for r in (r for r in rows if r["policy"] == policy and r["world"] == world):
                s = r["success"]
                x = j + (i - (len(policies) - 1) / 2) * width
                label = policy if j == 0 else None
                style = {"color": COLOURS[modality], "hatch": hatch, "edgecolor": "white", "linewidth": 0}
                axes.bar(x, 100 * s["value"], 0.92 * width, label=label, **style)
                low, high = 100 * (s["value"] - s["low"]), 100 * (s["high"] - s["value"])
                axes.errorbar(x, 100 * s["value"], [[max(low, 0)], [max(high, 0)]], color="black", lw=1, capsize=2)
    axes.set_xticks(range(len(worlds)), [WORDS[w] for w in worlds])
    axes.set_ylim(0, 105)
    axes.set_ylabel("success, %")
    axes.grid(axis="y", alpha=0.3)
    axes.set_axisbelow(True)
    axes.legend(ncols=5, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False, fontsize=8)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    figure.tight_layout()
    figure.savefig(picture)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
