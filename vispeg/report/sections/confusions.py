"""The section on effects that these recordings cannot distinguish, and the experiment that could."""

from __future__ import annotations

from collections.abc import Mapping

from vispeg.report.record import Record
from vispeg.report.text import words
from vispeg.report.text.quantities import number, plain

TITLE = "What cannot be distinguished"


def context(record: Record) -> Mapping[str, object]:
    """Return the classes of indistinguishable effects, each with the member in the model first, and an experiment."""
    following = record.mapping("next_experiment")
    sigma = number(following.get("expected_separation_sigma"))
    return {
        "combinations": [words.join(members) for members in words.combinations(record.values)],
        "classes": words.rivals(record.values),
        "named": bool(record.rows("effects") or record.rows("partial")),
        "remedy": str(following.get("why") or "").rstrip("."),
        "sigma": plain(sigma, 2) if sigma else "",  # zero means not predicted
    }
