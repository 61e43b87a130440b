"""Draws the README picture of the falling error, from the results of a diagnosis, such as those of `vispeg demo`.

python scripts/make_error_picture.py vispeg-demo docs/img/error-falling.png
"""

from __future__ import annotations

import sys
from pathlib import Path

from vispeg.report.drawings.figures import styled
from vispeg.report.drawings.ladder import ladder_figure
from vispeg.report.record import load_record


def main(found: Path, picture: Path) -> None:
    """Draw the errors of the diagnosis in `found`, step by step, on white."""
    with styled():
        figure = ladder_figure(load_record(found))
        if figure is None:
            sys.exit(f"{found}: holds no errors to draw")
        figure.savefig(picture, dpi=115, facecolor="white")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(sys.argv[2]))
