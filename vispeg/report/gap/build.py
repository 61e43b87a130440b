"""Build the page of a gap (gap.json) or of an evaluation in one world (evaluate.json)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vispeg.core.files import write_text_atomic
from vispeg.evaluation.folder import EPISODES
from vispeg.evaluation.records import Episode
from vispeg.evaluation.records import read as read_episodes
from vispeg.formats.format import Format, enrol
from vispeg.formats.guard import MB, as_written
from vispeg.formats.json_data import read_json
from vispeg.report.gap import (
    against,
    controls,
    factors,
    failures,
    headline,
    measured,
    pairs,
    prediction,
    success,
)
from vispeg.report.gap.page import page
from vispeg.report.live import episodes

FORMAT = "vispeg-gap/2"
GAP = Format(FORMAT, "a gap's record", language="json", most=64 * MB)
KINDS = {"gap": "transfer gap", "evaluate": "evaluation"}  # command, which also names the record and the page -> title


def render(
    values: Mapping[str, Any],
    media: Sequence[Mapping[str, Any]] = (),
    folder: Path = Path(),
    command: str = "gap",
    played: Sequence[Episode] = (),
) -> str:
    """Return the page as HTML.

    Args:
        values: the record.
        media: pairs of videos and pictures, see `pairs.context`.
        folder: folder of the media.
        command: one of KINDS.
        played: the episodes that were played.
    """
    sections: list[tuple[str, str, Mapping[str, Any]]] = [("headline", headline.TITLE, headline.context(values))]
    if (by_control := controls.context(values)) is not None:
        sections.append(("controls", controls.TITLE, by_control))
    if values["gaps"]:
        sections.append(("factors", factors.TITLE, factors.context(values)))
    sections.append(("success", success.TITLE, success.context(values)))
    if values["comparisons"]:
        sections.append(("against", against.TITLE, against.context(values)))
    if (paired := episodes.context(values, played, media)) is not None:
        sections.append(("episodes", episodes.TITLE, paired))
    if values["prediction"]:
        sections.append(("prediction", prediction.TITLE, prediction.context(values)))
    failed = failures.context(values)
    if failed["picture"] or failed["rows"]:
        sections.append(("failures", failures.TITLE, failed))
    if media:
        heading = pairs.TITLE if any(len(m["sides"]) > 1 for m in media) else pairs.SINGLE
        sections.append(("pairs", heading, pairs.context(media, folder)))
    sections.append(("measured", measured.TITLE, measured.context(values)))
    return page(f"vispeg {command}", KINDS[command], sections)


def write(out: Path, command: str = "gap", *, overwrite: bool = False) -> Path:
    """Read OUT/COMMAND.json and, if it exists, OUT/media.json; write OUT/COMMAND.html and return its path.

    Raises:
        UserError: no such record, another format, or the page exists and `overwrite` is False.
    """
    return write_text_atomic(Path(out) / f"{command}.html", read(Path(out), command), overwrite=overwrite)


def _example(folder: Path) -> Path:
    import json

    from vispeg.evaluation.example import episodes
    from vispeg.evaluation.gap import gap

    (folder / "gap.json").write_text(json.dumps(gap(episodes(), worlds=["S", "V"])), encoding="utf-8")
    return folder


@enrol(FORMAT, _example, slow=True)
def read(out: Path, command: str = "gap") -> str:
    """Return the page of OUT/COMMAND.json with the media that OUT/media.json lists. Raises UserError as `write`."""
    path, listed = out / f"{command}.json", out / "media.json"
    values = GAP.read(path)
    media = read_json(listed) if listed.exists() else []
    log = out / EPISODES
    played = read_episodes(log) if log.exists() else []
    with as_written(path, f"vispeg {command}"):
        return render(values, media, out, command, played)
