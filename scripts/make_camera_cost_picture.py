"""Draws the success of policies with a camera as trained, with a hidden error, and with that error corrected.

python scripts/make_camera_cost_picture.py docs/img/camera_cost.png docs/results/camera_cost.json
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from vispeg.report.drawings.figures import AFTER, BEFORE, MEASURED, MUTED, WIDE, new_figure, quiet, styled


def main(picture: Path, results: list[Path]) -> None:
    """Draw bars with 95 % intervals, one group for each policy, on white."""
    rows = [row for path in results for row in json.loads(path.read_text(encoding="utf-8"))["rows"]]
    colours = {"as trained": MUTED, "hidden error": BEFORE, "corrected": AFTER}
    with styled():
        figure = new_figure(2.8, WIDE.width)
        ax = figure.add_subplot()
        for k, row in enumerate(rows):
            for j, (way, colour) in enumerate(colours.items()):
                e = {key: 100 * value for key, value in row["success"][way].items() if key != "n"}
                x = k + 0.27 * (j - 1)
                ax.bar(x, e["value"], 0.24, color=colour, label=way if k == 0 else None)
                ends = [[e["value"] - e["low"]], [e["high"] - e["value"]]]
                ax.errorbar(x, e["value"], ends, color=MEASURED, lw=1)
                ax.text(x, 3, f"{e['value']:.0f}", ha="center", color="white")
        ax.set_xticks(range(len(rows)), [row["policy"] for row in rows])
        ax.set_ylabel("success, %")
        ax.set_ylim(0, 104)
        ax.set_xlim(-0.6, len(rows) - 0.4)
        figure.legend(loc="outside upper right", ncols=len(colours))
        quiet(ax)
        figure.savefig(picture, dpi=140, facecolor="white")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), [Path(path) for path in sys.argv[2:]])
