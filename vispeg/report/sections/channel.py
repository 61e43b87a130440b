"""The first section of one channel in a diagnosis of several: its verdict and the decrease of its error."""

from __future__ import annotations

from collections.abc import Mapping

from vispeg.report.drawings.figures import chart
from vispeg.report.drawings.ladder import ladder_figure
from vispeg.report.record import Record
from vispeg.report.text import contact_words, words


def context(record: Record, channel: str) -> Mapping[str, object]:
    """Return what a channel's first section shows.

    It is the verdict and its reason, the decrease of the error in words and as a picture (none if the ladder has one
    model), the phases of a contact channel, and the error that remains if the channel is unexplained.
    """
    values = record.values
    drawn = chart(lambda shape: ladder_figure(record, shape), f"ladder-{channel}", words.fall(values))
    return {
        "verdict": str(values.get("verdict") or ""),
        "fall": words.fall(values),
        "phases": contact_words.phases(values),
        "left": contact_words.left(values) if values.get("unexplained") else "",
        "reason": words.reason(values),
        "picture": drawn if len(record.rows("ladder")) > 1 else "",
    }
