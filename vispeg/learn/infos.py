"""Rows of the infos of gymnasium's vector environments; without torch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


def row_info(info: Mapping[str, Any], row: int) -> dict[str, object]:
    """Return one row of a gymnasium vector info: the entries whose mask `_name` is True in that row, or is absent."""
    entries: dict[str, object] = {}
    for name, value in info.items():
        if name.startswith("_") or not bool(np.asarray(info.get(f"_{name}", np.ones(row + 1, bool)))[row]):
            continue
        entries[name] = row_info(value, row) if isinstance(value, dict) else value[row]
    return entries
