"""Sections of the smaller pages: a title with lines of text, a picture with a table, and the origin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Section = tuple[str, str, Mapping[str, Any]]


def title(text: str, lines: Sequence[str]) -> Section:
    """Return the first section: a title, and one line per finding."""
    return "title", "", {"title": text, "lines": list(lines)}


def table(
    heading: str,
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    picture: str = "",
    caption: str = "",
    note: str = "",
) -> Section:
    """Return a heading with a picture (SVG text), a table and a note; any of the three may be empty."""
    values = {
        "heads": list(heads),
        "rows": [list(r) for r in rows],
        "picture": picture,
        "caption": caption,
        "note": note,
    }
    return "table", heading, values


def origin(values: Mapping[str, Any]) -> Section:
    """Return the last section: worlds, command and versions."""
    worlds = [values["world"]] if values.get("world") else list(values.get("worlds") or ())
    return (
        "origin",
        "How this was measured",
        {
            "worlds": worlds,
            "provenance": values.get("provenance") or {},
        },
    )
