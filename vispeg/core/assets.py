"""Find the folder of files that the program needs at run time: meshes, models, bundled recordings."""

from __future__ import annotations

from pathlib import Path

from vispeg.core.errors import UserError

PACKAGE = Path(__file__).resolve().parents[1]


def assets() -> Path:
    """Return the assets folder: the one inside the installed package, else `assets/` of a checkout.

    Raises:
        UserError: neither exists, so the installation is damaged.
    """
    for folder in (PACKAGE / "_assets", PACKAGE.parent / "assets"):
        if folder.is_dir():
            return folder
    raise UserError("the assets folder is missing; install vispeg again", file=PACKAGE)
