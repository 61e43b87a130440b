"""How it was measured: worlds with their hashes, the rule, the command."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.gap import words

TITLE = "How this was measured"


def context(values: Mapping[str, Any]) -> dict[str, Any]:
    """Worlds, policies, rule, notes, provenance."""
    return {
        "worlds": values["worlds"],
        "policies": [{**p, "role": words.role(p)} for p in values["policies"]],
        "notes": values["notes"],
        "rule": values["rule"],
        "provenance": values.get("provenance") or {},
    }
