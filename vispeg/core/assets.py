"""Where the files are that the program needs at run time: meshes, models, bundled recordings."""

from __future__ import annotations

from pathlib import Path

from vispeg.core.errors import UserError

PACKAGE = Path(__file__).resolve().parents[1]


def assets() -> Path:
    """Give the assets folder: inside the installed package, or `assets/` of a checkout.

    Raises:
        UserError: neither is there, so the installation is damaged.
    """
    for folder in (PACKAGE / "_assets", PACKAGE.parent / "assets"):
        if folder.is_dir():
            return folder
    raise UserError("the assets folder is missing; install vispeg again", file=PACKAGE)
