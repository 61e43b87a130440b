"""The input of a report: the record of a diagnosis, comparison or fit, and its evidence."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.json_data import read_json
from vispeg.report.evidence import Evidence, load_evidence
from vispeg.report.text.quantities import number

SHEET, ROBOT = "contact-sheet.png", "robot.png"


@dataclass(frozen=True)
class Record:
    """The record of a finished run, with its evidence.

    Attributes:
        kind: "diagnosis", "compare" or "fit".
        values: the JSON record; keys may be absent or null.
        evidence: the arrays.
        sheet, robot: PNG of a contact sheet and of the robot, from the record's folder; None if absent.
    """

    kind: Literal["diagnosis", "compare", "fit"]
    values: Mapping[str, Any]
    evidence: Evidence
    sheet: bytes | None = None
    robot: bytes | None = None

    def rows(self, key: str) -> list[Mapping[str, Any]]:
        """Return the list of mappings under `key`; empty if absent or null."""
        return rows(self.values, key)

    def mapping(self, key: str) -> Mapping[str, Any]:
        """Return the mapping under `key`; empty if absent or null."""
        value = self.values.get(key)
        return value if isinstance(value, dict) else {}

    @property
    def floor(self) -> float | None:
        """The noise floor, in the ladder's unit."""
        return number(self.mapping("noise_floor").get("value"))


def rows(values: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    """Return the mappings in the list under `key`; empty if absent or null."""
    value = values.get(key)
    return [row for row in value if isinstance(row, dict)] if isinstance(value, list) else []


def params_of(effect: Mapping[str, Any]) -> Mapping[str, Mapping[str, Any]]:
    """Return an effect's parameters, name -> {value, low, high, unit}; a bare number becomes {value}."""
    params = effect.get("params")
    pairs = params.items() if isinstance(params, dict) else ()
    return {str(name): p if isinstance(p, dict) else {"value": p} for name, p in pairs}


def label(row: Mapping[str, Any]) -> str:
    """Return the label of a mapping with `effect` and `where`, such as `coulomb_friction(joint4)`."""
    where = row.get("where")
    return f"{row.get('effect', '?')}({where})" if where else str(row.get("effect", "?"))


def data_link(png: bytes) -> str:
    """Return a PNG as a `data:` link, so that the page needs no other file."""
    return "data:image/png;base64," + base64.b64encode(png).decode()


def still(image: np.ndarray) -> str:
    """Encode a picture (H, W, 3) uint8 as JPEG; return it as a `data:` link."""
    import cv2

    done, data = cv2.imencode(".jpg", np.ascontiguousarray(image[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 88])
    if not done:
        raise ValueError(f"not a picture: {image.shape} {image.dtype}")
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()


def load_record(out: Path) -> Record:
    """Read OUT/diagnosis.json, else OUT/compare.json, else OUT/fit.json, with OUT/evidence.npz.

    Raises:
        UserError: none of the three exists, a file cannot be read, or it is no such record (see `recognised`).
    """
    for kind in ("diagnosis", "compare", "fit"):
        path = out / f"{kind}.json"
        if path.is_file():
            pngs = [(out / name).read_bytes() if (out / name).is_file() else None for name in (SHEET, ROBOT)]
            read = renamed(recognised(read_json(path, finite=False), kind, path))
            values = read if kind != "fit" else _judged(read)
            return Record(kind, values, load_evidence(out / "evidence.npz"), *pngs)
    raise UserError("nothing to report on", file=out, expected="a folder with diagnosis.json, compare.json or fit.json")


def _judged(values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a fit's record; if nothing was held out, with the errors on the fitted recordings under `heldout_error`.

    `judged` is then "fitted".
    """
    ladder = rows(values, "ladder")
    if any(number(row.get("heldout_error")) is not None for row in ladder):
        return values
    relabelled = [{**row, "heldout_error": row.get("fit_error"), "fit_error": None} for row in ladder]
    return {**values, "ladder": relabelled, "judged": "fitted"}


def recognised(values: Any, name: str, path: Path) -> dict[str, Any]:
    """Return the content of a result's file if its format is a version of `vispeg-NAME`, or not stated.

    Raises:
        UserError: it is no mapping, has another format, or is a fit by the paper's protocol (`vispeg.identify.paper`),
            whose fit.json has no effects.
    """
    if not isinstance(values, dict):
        raise UserError("is not a record", file=path, expected="a mapping", got=type(values).__name__)
    stated = values.get("format")
    if stated is not None and str(stated).partition("/")[0] != f"vispeg-{name}":
        raise UserError("is another kind of result", file=path, key="format", expected=f"vispeg-{name}", got=stated)
    if values.get("protocol") == "paper":
        expected = "a fit of named effects; this one's model is model.yaml, its pictures paths-*.png"
        raise UserError("is a fit by the paper's protocol", file=path, key="protocol", expected=expected)
    return values


def renamed(values: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a record with the present names of its keys; older records call a channel a room."""
    if "rooms" not in values:
        return values

    def each(key: str) -> list[Mapping[str, Any]]:
        return [{"channel" if k == "room" else k: v for k, v in row.items()} for row in rows(values, key)]

    rest = {key: value for key, value in values.items() if key != "rooms"}
    return {**rest, "effects": each("effects"), "by_channel": each("rooms")}
