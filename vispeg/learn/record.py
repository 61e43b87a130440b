"""Read and check policy.json: a policy's modality, layout, network, origin, and the hash of its weights. No torch."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NotRequired, TypedDict, cast

from vispeg.core.assets import assets
from vispeg.core.errors import UserError
from vispeg.core.provenance import digest
from vispeg.formats.format import Format, copy, enrol
from vispeg.formats.guard import is_file
from vispeg.formats.json_data import read_json
from vispeg.learn.layout import Layout
from vispeg.learn.meta import interface, observed
from vispeg.learn.shipped import META
from vispeg.task.registry import config_of

KEYS = ("modality", "layout", "net", "meta", "weights")
NETWORK = Format("vispeg-policy/1", "a policy", KEYS, ("modality", "layout"), "json")
PAIR = Format("vispeg-coarse-to-fine/1", "a policy of two", ("modality", "within", "meta"), ("within",), "json")
WEIGHTS = "policy.safetensors"
COARSE, FINE = "coarse", "fine"  # sub-folders of a pair, each with one policy
# of one policy or a pair
FILES = tuple(f"{part}{name}" for part in ("", f"{COARSE}/", f"{FINE}/") for name in (META, WEIGHTS))
WIDEST, LAYERS = 8192, 16  # largest width of a layer, largest number of layers


def _example(folder: Path) -> Path:
    return copy(assets() / "policies" / "state-3mm" / META, folder).parent


def _example_of_two(folder: Path) -> Path:
    path = _example(folder) / META
    record = {"format": PAIR.name, "modality": "state", "within": 0.01, "meta": read_json(path)["meta"]}
    path.write_text(json.dumps(record), encoding="utf-8")
    return path.parent


class Net(TypedDict):
    """Widths of a network's hidden layers, and of its LSTM (0: none)."""

    hidden: list[int]
    recurrent: int


class PolicyRecord(TypedDict):
    """The content of policy.json. A coarse-to-fine pair has `within`, in m, and no `layout`, `net` or `weights`."""

    format: str
    modality: str
    meta: Mapping[str, Any]
    layout: NotRequired[Mapping[str, Any]]
    net: NotRequired[Net]
    weights: NotRequired[str]
    within: NotRequired[float]


@enrol(PAIR.name, _example_of_two)
@enrol(NETWORK.name, _example)
def read_record(folder: Path) -> PolicyRecord:
    """Return the content of policy.json, of one network or of a pair; `format` tells which.

    Raises:
        UserError: the folder holds no policy, or an entry is invalid; the error names its key.
    """
    path = folder / META
    if not is_file(path):
        raise UserError("not a policy's folder", file=folder, expected=f"{WEIGHTS} and {META}")
    kind = PAIR if _format_of(path) == PAIR.name else NETWORK
    record = kind.read(path)
    meta = record.setdefault("meta", {})
    _check_meta(meta, path)
    if kind is PAIR:
        within = record["within"]
        if isinstance(within, bool) or not isinstance(within, int | float) or not 0 < within <= 1:
            raise UserError(
                "not a distance", file=path, key="within", expected="metres, above 0 and at most 1", got=within
            )
        return cast("PolicyRecord", {"format": kind.name, **record})
    if not isinstance(record["modality"], str):
        raise UserError("not a modality", file=path, key="modality", got=record["modality"])
    try:
        layout = Layout.from_json(record["layout"])
    except UserError as error:
        raise UserError(str(error), file=path) from None
    _check_layout(layout, meta, path)
    net = record.setdefault("net", {})
    if not isinstance(net, dict):
        raise UserError("not a network", file=path, key="net", expected="hidden, recurrent", got=net)
    hidden, recurrent = net.setdefault("hidden", [256, 256]), net.setdefault("recurrent", 0)
    if not isinstance(hidden, list) or not 1 <= len(hidden) <= LAYERS or not all(_is_width(n, 1) for n in hidden):
        raise UserError("not widths of layers", file=path, key="net.hidden", expected=f"1 to {WIDEST} each", got=hidden)
    if not _is_width(recurrent, 0):
        raise UserError("not a width", file=path, key="net.recurrent", expected=f"0 to {WIDEST}", got=recurrent)
    if not isinstance(record.get("weights", ""), str):
        raise UserError("not a hash", file=path, key="weights", expected="sha256:...", got=record["weights"])
    return cast("PolicyRecord", {"format": kind.name, **record})


def policy_digest(path: Path) -> str:
    """Return the digest of a policy's own files, which tells it from other policies.

    Results or notes that somebody puts into its folder do not make it another policy. Of a path without policy.json,
    such as an exported policy, the digest of all that is there.

    Raises:
        UserError: the file or folder cannot be read.
    """
    return digest(path, FILES if (path / META).is_file() else None)


def check_weights(folder: Path, record: PolicyRecord) -> None:
    """Raise UserError where the weights are missing or lack the recorded hash, if any: older records have none."""
    path = folder / WEIGHTS
    if not is_file(path):
        raise UserError("is missing, or no file", file=path, expected="the policy's weights")
    stated = record.get("weights")
    if stated is not None and stated != (got := f"sha256:{digest(path)}"):
        raise UserError("are not the weights of the policy.json beside them", file=path, expected=stated, got=got)


def _format_of(path: Path) -> Any:
    record = read_json(path)
    return record.get("format") if isinstance(record, dict) else None


def _check_meta(meta: Any, path: Path) -> None:
    """Raise UserError where an entry of `meta` has the wrong type or an invalid value."""
    if not isinstance(meta, dict):
        raise UserError("not a mapping", file=path, key="meta", got=meta)
    tuned = meta.get("finetuned")
    for key, record in (("meta", meta), ("meta.finetuned", tuned if isinstance(tuned, dict) else {})):
        for name, kind in (("world", str), ("world_hash", str), ("world_file", str), ("task", dict)):
            if not isinstance(record.get(name), kind | None):
                raise UserError("has the wrong type", file=path, key=f"{key}.{name}", got=record[name])
        hashes, made_of = record.get("world_hashes") or [], record.get("world_parts") or {}
        if not isinstance(hashes, list) or not all(isinstance(h, str) for h in hashes):
            raise UserError("not a list of hashes", file=path, key=f"{key}.world_hashes", got=hashes)
        if not isinstance(made_of, dict) or not all(isinstance(name, str) for name in made_of.values()):
            raise UserError("not a mapping of hashes to names", file=path, key=f"{key}.world_parts", got=made_of)
    if not isinstance(tuned, dict | None):
        raise UserError("not a mapping", file=path, key="meta.finetuned", got=tuned)
    try:
        config_of(interface(meta), "meta.task")
    except (UserError, TypeError, ValueError) as error:
        raise UserError(str(error), file=path) from None


def _check_layout(layout: Layout, meta: Mapping[str, Any], path: Path) -> None:
    """Raise UserError where a policy's layout does not match the task that its record names."""
    task, stated = config_of(interface(meta)), interface(meta)
    length = task.stack * observed(meta).policy_size
    if {"stack", "dof"} <= stated.keys() and layout.vector != length:
        expected = f"{length} by meta.task"
        raise UserError("not the task's length", file=path, key="layout.vector", expected=expected, got=layout.vector)
    if "dof" in stated and layout.action != len(task.dof):
        expected = f"{len(task.dof)} by meta.task"
        raise UserError("not the task's length", file=path, key="layout.action", expected=expected, got=layout.action)
    for key in layout.images if "cameras" in stated else ():
        if key.partition("_")[2] not in task.cameras:
            raise UserError("not a camera of the task", file=path, key=f"layout.images.{key}", choices=task.cameras)


def _is_width(value: Any, least: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and least <= value <= WIDEST
