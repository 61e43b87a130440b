"""Builds the page of a gap (gap.json) or of an evaluation in one world (evaluate.json), and the media beside it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.report.gap import against, controls, factors, failures, headline, measured, pairs, prediction, success
from vispeg.report.gap.page import page

FORMAT = "vispeg-gap/1"
KINDS = {"gap": "transfer gap", "evaluate": "evaluation"}  # command, also the stem of record and page -> what it is


def render(
    values: Mapping[str, Any], media: Sequence[Mapping[str, Any]] = (), folder: Path = Path(), command: str = "gap"
) -> str:
    """The page as text; `media` as `pairs.context` takes it, `command` one of KINDS."""
    sections: list[tuple[str, str, Mapping[str, Any]]] = [("headline", headline.TITLE, headline.context(values))]
    if (found := controls.context(values)) is not None:
        sections.append(("controls", controls.TITLE, found))
    if values["gaps"]:
        sections.append(("factors", factors.TITLE, factors.context(values)))
    sections.append(("success", success.TITLE, success.context(values)))
    if values["comparisons"]:
        sections.append(("against", against.TITLE, against.context(values)))
    if values["prediction"]:
        sections.append(("prediction", prediction.TITLE, prediction.context(values)))
    sections.append(("failures", failures.TITLE, failures.context(values)))
    if media:
        heading = pairs.TITLE if any(len(m["sides"]) > 1 for m in media) else pairs.SINGLE
        sections.append(("pairs", heading, pairs.context(media, folder)))
    sections.append(("measured", measured.TITLE, measured.context(values)))
    return page(f"vispeg {command}", KINDS[command], sections)


def write(out: Path, command: str = "gap", *, overwrite: bool = False) -> Path:
    """Reads OUT/COMMAND.json and, where there is one, OUT/media.json; writes OUT/COMMAND.html and returns its path.

    Raises:
        UserError: no such record, another format, or a page there already while `overwrite` is False.
    """
    path = Path(out) / f"{command}.json"
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError("cannot be read", file=path, got=str(error)) from None
    if not isinstance(values, dict) or values.get("format") != FORMAT:
        got = values.get("format") if isinstance(values, dict) else values
        raise UserError("not a gap's record", file=path, key="format", expected=FORMAT, got=got)
    listed = Path(out) / "media.json"
    media = json.loads(listed.read_text(encoding="utf-8")) if listed.is_file() else []
    html = render(values, media, Path(out), command)
    return write_text_atomic(path.with_suffix(".html"), html, overwrite=overwrite)
