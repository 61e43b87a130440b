"""The policies that come with the package, by name. Without torch."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vispeg.core.assets import assets
from vispeg.core.errors import UserError

META = "policy.json"  # what makes a folder a policy's


def names() -> list[str]:
    """Names of the policies that come with the package."""
    return sorted(path.parent.name for path in (assets() / "policies").glob(f"*/{META}"))


def policy_folder(place: str | Path, others: Sequence[str] = ()) -> Path:
    """Give the folder that is meant: one that is there, else a shipped policy's of that name.

    Args:
        place: a folder, or a name.
        others: what else may be named in its place, for the error.

    Raises:
        UserError: neither; the names are listed.
    """
    path = Path(place).expanduser()
    if path.exists():
        return path
    if str(place) in names():
        return assets() / "policies" / str(place)
    raise UserError("no such policy", got=str(place), expected="a policy's folder or name", choices=[*others, *names()])
