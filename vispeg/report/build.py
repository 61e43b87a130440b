"""Build the self-contained HTML report of a finished diagnosis, comparison or fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from vispeg.core.files import write_text_atomic
from vispeg.formats.format import enrol
from vispeg.formats.guard import as_written
from vispeg.report.evidence import Evidence
from vispeg.report.page import Section, page
from vispeg.report.record import Record, load_record
from vispeg.report.sections import (
    CHANNELS,
    COMPARE,
    CONTACT,
    CONTACT_COMPARE,
    DIAGNOSIS,
    FIT,
    OBJECT,
    PICTURES_COMPARE,
    SHARED,
    VIEWS,
)
from vispeg.report.sections import channel as channel_section

KINDS = {"diagnosis": "diagnosis", "compare": "comparison", "fit": "fit"}  # kind of a record -> its name in words


def write_report(out: Path, *, overwrite: bool = False) -> Path:
    """Read the record in OUT (see `load_record`) and OUT/evidence.npz, write OUT/report.html; return its path.

    Args:
        out: folder that `vispeg diagnose`, `vispeg compare` or `vispeg fit` wrote.
        overwrite: replace report.html if it exists.

    Raises:
        UserError: no record in `out`, a file that cannot be read, or the report exists and `overwrite` is False.
    """
    return write_text_atomic(Path(out) / "report.html", read(Path(out)), overwrite=overwrite)


def _example(folder: Path) -> Path:
    import json

    friction = {"effect": "coulomb_friction", "where": "joint4", "indistinguishable_from": []}
    friction["params"] = {"torque": {"value": 1.3, "low": 1.2, "high": 1.4, "unit": "N m"}}
    steps = [("nominal", 9.1e-3, 8.8e-3), ("+ coulomb_friction(joint4)", 2.1e-4, 2.2e-4)]
    record = {
        "format": "vispeg-diagnosis/1",
        "verdict": "identified",
        "effects": [friction],
        "ladder": [
            dict(zip(("model", "fit_error", "heldout_error"), s, strict=True)) | {"unit": "rad RMS"} for s in steps
        ],
        "noise_floor": {"value": 2.0e-4, "unit": "rad RMS", "from": "repeats"},
        "where_it_fails": [{"joint": "joint4", "regime": "velocity reversal", "share": 0.51}],
        "unexplained": None,
        "next_experiment": {"motion": "slow triangle on joint4", "why": "separates", "expected_separation_sigma": 9.4},
        "candidates": [{"effect": "backlash", "where": "joint2", "heldout_gain": -0.02, "rejected_because": "no gain"}],
        "screening": [{"effect": "payload", "where": "flange", "score": 0.81, "cosine_group": 0}],
        "provenance": {
            "command": "vispeg diagnose",
            "seed": 0,
            "versions": {"vispeg": "1"},
            "inputs": {"a": "ab"},
        },
        "recordings": {"fit": ["rig-a"], "validate": ["rig-b"]},
        "notes": ["rig-b: 3 rows without a reading were left out"],
        "correlations": {"labels": ["a", "b"], "matrix": [[1.0, -0.9], [-0.9, None]]},
    }
    (folder / "diagnosis.json").write_text(json.dumps(record), encoding="utf-8")
    return folder


@enrol("vispeg-diagnosis/1", _example, slow=True)
def read(out: Path) -> str:
    """Return the report of a folder as HTML. Raises UserError: as `write_report`."""
    record = load_record(out)
    with as_written(out / f"{record.kind}.json", f"vispeg {record.kind.replace('diagnosis', 'diagnose')}"):
        return render(record)


def render(record: Record) -> str:
    """Return the report as HTML, without external links or requests."""
    channels = record.rows("by_channel")
    # with several channels, a diagnosis shows their summary first, a comparison its main record
    names = CHANNELS if channels and record.kind == "diagnosis" else _names(record)
    sections = _sections(record, [n for n in names if not channels or n != "provenance"])
    for channel in channels:
        sections += _channel(record, channel)
    sections += _sections(record, ("provenance",)) if channels else []
    kind = KINDS[record.kind]
    verdict = record.values.get("verdict") if record.kind == "diagnosis" else None
    return page(f"vispeg {kind}" + (f": {verdict}" if verdict else ""), kind, sections)


def _names(record: Record) -> tuple[str, ...]:
    """Return the names of the sections that show a record of one channel."""
    values, contact = record.values, record.values.get("evidence") == "contact"
    if record.kind == "fit":
        return FIT
    if record.kind == "compare":
        pictures_alone = values.get("pictures") and "joints" not in values
        return CONTACT_COMPARE if contact else PICTURES_COMPARE if pictures_alone else COMPARE
    return OBJECT if values.get("object") else VIEWS if values.get("views") else CONTACT if contact else DIAGNOSIS


def _sections(record: Record, names: Sequence[str], channel: str = "") -> list[Section]:
    """Return the named sections that have content; with `channel`, their titles begin with it."""
    out = []
    for name in names:
        module = import_module(f"vispeg.report.sections.{name}")
        values = module.context(record)
        if values is not None:
            interactive = not values.get("still")
            scripts, styles = (getattr(module, n, ()) if interactive else () for n in ("SCRIPTS", "STYLES"))
            title = f"{channel.capitalize()}: {module.TITLE[0].lower()}{module.TITLE[1:]}" if channel else module.TITLE
            anchor = f"{channel}-{name}" if channel else name
            out.append(Section(anchor, title, f"sections/{name}", values, scripts, styles))
    return out


def _channel(record: Record, channel: Mapping[str, Any]) -> list[Section]:
    """Return the sections of one entry of `by_channel`: its verdict first, then those of its kind of evidence."""
    name = str(channel.get("channel"))
    inner = Record(record.kind, channel.get("record") or {}, record.evidence.by_channel.get(name, Evidence()))
    values = channel_section.context(inner, name)
    first = Section(f"channel-{name}", name.capitalize(), "sections/channel", values)
    return [first, *_sections(inner, [n for n in _names(inner) if n not in SHARED], name)]
