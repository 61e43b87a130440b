"""Draws success over time of training runs, one panel for each world, with 95 % bands.

The first argument is a folder with one folder for each run, which holds the run's `config.yaml` and `progress.csv` and
gives the curve its name.

python scripts/make_recipes_picture.py docs/results/recipes docs/img/recipes.png
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from vispeg.evaluation.statistics import wilson
from vispeg.learn.config import read_config


def main(folder: Path, picture: Path) -> None:
    """Draw a curve for each run: success of the evaluation's episodes against minutes since the run began."""
    runs = [
        (place, read_config(place / "config.yaml")) for place in sorted(p.parent for p in folder.glob("*/progress.csv"))
    ]
    worlds = sorted({config.world for _, config in runs}, reverse=True)
    names = sorted({place.name.split(" in ")[0] for place, _ in runs})
    figure, panels = plt.subplots(1, len(worlds), figsize=(9, 3.6), dpi=130, sharey=True, squeeze=False)
    for axes, world in zip(panels[0], worlds, strict=True):
        for place, config in runs:
            if config.world != world:
                continue
            with (place / "progress.csv").open(newline="") as file:
                rows = list(csv.DictReader(file))
            name = place.name.split(" in ")[0]
            colour = f"C{names.index(name)}"
            minutes = [float(row["seconds"]) / 60 for row in rows]
            rates = [wilson(round(float(row["success"]) * config.episodes), config.episodes) for row in rows]
            axes.plot(minutes, [100 * r.value for r in rates], color=colour, marker=".", label=name)
            low, high = [100 * r.low for r in rates], [100 * r.high for r in rates]
            axes.fill_between(minutes, low, high, color=colour, alpha=0.15, lw=0)
        axes.set_title(world, fontsize=10)
        axes.set_xlabel("minutes of one core")
        axes.set_xlim(left=0)
        axes.set_ylim(0, 102)
        axes.grid(alpha=0.3)
        axes.legend(frameon=False, fontsize=8, loc="lower right")
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    panels[0][0].set_ylabel("success, %")
    figure.tight_layout()
    figure.savefig(picture)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
