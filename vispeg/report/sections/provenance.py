"""The section on provenance: command, seed, versions, inputs with hashes, recordings, notes."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import Any

from vispeg.report.record import Record

TITLE = "Provenance"


def context(record: Record) -> Mapping[str, object]:
    """Return everything needed to repeat the run, as text."""
    section = record.mapping("provenance")
    command = section.get("command")
    recordings = record.mapping("recordings")
    return {
        "command": shlex.join(map(str, command)) if isinstance(command, list) else str(command or ""),
        "seed": "" if section.get("seed") is None else str(section["seed"]),
        "versions": _pairs(section.get("versions")),
        "inputs": _pairs(section.get("inputs")),
        "fit": _names(recordings.get("fit")),
        "validate": _names(recordings.get("validate")) or [t.name for t in record.evidence.traces],
        "notes": _names(record.values.get("notes")),
        "others": _pairs({k: v for k, v in section.items() if k not in ("command", "seed", "versions", "inputs")}),
        "format": str(record.values.get("format") or ""),
    }


def _pairs(value: Any) -> list[tuple[str, str]]:
    if isinstance(value, dict):
        return [(str(k), str(v)) for k, v in value.items()]
    return [(name, "") for name in _names(value)]


def _names(value: Any) -> list[str]:
    return [str(v) for v in value] if isinstance(value, (list, tuple)) else [str(value)] if value else []
