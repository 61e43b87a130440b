"""The section that summarizes the channels of a diagnosis: verdict, error and effects of each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vispeg.report.record import Record, label, rows
from vispeg.report.text import words
from vispeg.report.text.quantities import quantity

TITLE = "Channels"


def context(record: Record) -> Mapping[str, object] | None:
    """Return one row per channel; None if there is only one channel."""
    channels = record.rows("by_channel")
    return {"channels": [channel_row(c) for c in channels]} if channels else None


def channel_row(channel: Mapping[str, Any]) -> dict[str, str]:
    """Return a channel's verdict, held-out errors, noise floor, named effects, and those taken from other channels."""
    record = channel.get("record") or {}
    before, after, unit = words.ladder_ends(record)
    floor = record.get("noise_floor") or {}
    return {
        "channel": str(channel.get("channel", "?")),
        "verdict": str(record.get("verdict", "")),
        "before": quantity(before, unit),
        "after": quantity(after, unit),
        "floor": quantity(floor.get("value"), str(floor.get("unit") or unit)),
        "named": ", ".join(label(e) for e in rows(record, "effects")),
        "given": ", ".join(label(e) for e in rows(channel, "given")),
        "reason": words.reason(record),
    }
