"""Draws the README picture of a `vispeg gap` result: the one that its page opens with.

python scripts/make_gap_picture.py docs/results/gap/gap.json docs/img/gap.png
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from vispeg.report.drawings.figures import WIDE, styled
from vispeg.report.gap.success import figure


def main(result: Path, picture: Path) -> None:
    """Draw bars with 95 % intervals, one group for each world, on white."""
    with styled():
        figure(json.loads(result.read_text(encoding="utf-8")), WIDE).savefig(picture, dpi=140, facecolor="white")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
