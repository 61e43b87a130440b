"""How the success was measured: worlds with their hashes, policies, statistical rule, command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vispeg.report.gap import words

TITLE = "How this was measured"


def context(values: Mapping[str, Any]) -> Mapping[str, object]:
    """Return the template's values: worlds, policies, rule, notes and provenance."""
    return {
        "worlds": values["worlds"],
        "policies": [{**p, "role": words.role(p), "at": _trained(p)} for p in values["policies"]],
        "several": any(len(p["train_seeds"]) > 1 for p in values["policies"]),
        "notes": _together(values["notes"], [p["name"] for p in values["policies"]]),
        "rule": values["rule"],
        "provenance": values.get("provenance") or {},
    }


def _trained(policy: Mapping[str, Any]) -> str:
    """Return the worlds of the page in which a policy was trained, in words."""
    if policy["scripted"]:
        return "nowhere"
    return "not known" if policy["home"] is None else ", ".join(policy["home"]) or "none of these, as they are now"


def _together(notes: Sequence[str], policies: Sequence[str]) -> list[str]:
    """Merge notes that say the same of several policies into one line."""
    policies_by_text: dict[str, list[str]] = {}
    for note in notes:
        name = next((p for p in sorted(policies, key=len, reverse=True) if note.startswith(f"{p} ")), "")
        policies_by_text.setdefault(note.removeprefix(name).strip(), []).append(name)
    lines = []
    for text, names in policies_by_text.items():
        colon = ":" if len(names) > 1 else ""
        lines.append(f"{', '.join(filter(None, names))}{colon} {text}".strip())
    return lines
