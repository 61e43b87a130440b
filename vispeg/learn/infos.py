"""Rows of what gymnasium's vector environments tell beside their observations; without torch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


def row_info(info: Mapping[str, Any], row: int) -> dict[str, object]:
    """One row of a gymnasium vector info: `name` where its mask `_name` holds, or where there is no mask."""
    entries: dict[str, object] = {}
    for name, value in info.items():
        if name.startswith("_") or not bool(np.asarray(info.get(f"_{name}", np.ones(row + 1, bool)))[row]):
            continue
        entries[name] = row_info(value, row) if isinstance(value, dict) else value[row]
    return entries
