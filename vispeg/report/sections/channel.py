"""One channel of a diagnosis over several: its verdict and the fall of its error, before what only it shows."""

from __future__ import annotations

from collections.abc import Mapping

from vispeg.report.drawings.figures import chart
from vispeg.report.drawings.ladder import ladder_figure
from vispeg.report.record import Record
from vispeg.report.text import contact_words, words


def context(record: Record, channel: str) -> Mapping[str, object]:
    """Verdict, the fall of the error in words and in a picture, the reason."""
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
