"""The policies that come with the package, by name. Without torch."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vispeg.core.assets import assets
from vispeg.core.errors import UserError
from vispeg.core.paths import expanded

META = "policy.json"  # every policy's folder has this file


def names() -> list[str]:
    """Return the names of the policies that come with the package, sorted."""
    return sorted(path.parent.name for path in (assets() / "policies").glob(f"*/{META}"))


def policy_folder(place: str | Path, others: Sequence[str] = ()) -> Path:
    """Return `place` if it exists, else the folder of the shipped policy of that name.

    Args:
        place: a folder, or the name of a shipped policy.
        others: further names that the caller accepts, listed in the error.

    Raises:
        UserError: there is neither; the error lists the names.
    """
    path = expanded(place)
    if path.exists():
        return path
    if str(place) in names():
        return assets() / "policies" / str(place)
    raise UserError("no such policy", got=str(place), expected="a policy's folder or name", choices=[*others, *names()])
