"""Read and write `vispeg-measurement/1` files: measured numbers with uncertainties, and the effects made from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import yaml

from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.params import Value
from vispeg.formats.format import Format, enrol
from vispeg.formats.typed import typed
from vispeg.formats.yaml_data import read_yaml
from vispeg.worlds.model_file import Plain, located, placed_dict, read_placed

FORMAT = "vispeg-measurement/1"
LEVEL = 0.95  # coverage of the intervals
KEYS = ("protocol", "of", "robot", "results", "effects", "conditions", "raw", "notes", "details", "provenance")
MEASUREMENT = Format(FORMAT, "a measurement", keys=KEYS, needed=("protocol", "results"))


@dataclass(frozen=True)
class BudgetRow:
    """One source of uncertainty.

    Attributes:
        source: its name.
        type: A (from repeats) or B (from knowledge of the instrument).
        u: standard uncertainty of the source, in its own unit.
        dof: degrees of freedom of `u`; None for infinitely many.
        sensitivity: derivative of the result with respect to the source.
        contribution: |sensitivity| * u, in the result's unit.
    """

    source: str
    type: Literal["A", "B"]
    u: float
    dof: float | None
    sensitivity: float
    contribution: float


@dataclass(frozen=True)
class Quantity:
    """One measured number.

    Attributes:
        quantity: its name.
        value, unit: the best estimate and its unit.
        u: combined standard uncertainty, in the same unit.
        dof: effective degrees of freedom (Welch-Satterthwaite); None for infinitely many.
        k: coverage factor for 95 %.
        low, high: the 95 % interval: value +- k u (`gum`), or quantiles of a Monte Carlo propagation.
        method: which of the two.
        budget: the sources of uncertainty.
        repeats: number of readings behind the value.
    """

    quantity: str
    value: float
    unit: str
    u: float
    dof: float | None
    k: float
    low: float
    high: float
    method: Literal["gum", "monte carlo"]
    budget: tuple[BudgetRow, ...] = ()
    repeats: int = 0

    def __post_init__(self) -> None:
        if not (self.u >= 0 and self.k >= 0 and self.repeats >= 0 and (self.dof is None or self.dof > 0)):
            raise UserError(f"{self.quantity}: a negative uncertainty, coverage factor, count or degree of freedom")
        if not self.low <= self.value <= self.high:
            expected = "low <= value <= high"
            raise UserError(
                f"{self.quantity}: wrong interval", expected=expected, got=[self.low, self.value, self.high]
            )


@dataclass(frozen=True)
class Measurement:
    """The result of one run of `vispeg measure`.

    Attributes:
        protocol: name of the protocol, such as `friction`.
        of: the measured object or joint.
        robot: name or path of the robot to which the effects belong; None if they fit any robot.
        results: the numbers.
        effects: effects for a model, made from the numbers with their 95 % intervals.
        conditions: conditions that the user stated, such as instrument, surface and temperature.
        raw: file with readings -> its SHA-256.
        notes: remarks on the results.
        details: further tables of the protocol (a Bode table, a torque-speed curve).
        provenance: command, seed and versions.
    """

    protocol: str
    of: str
    results: tuple[Quantity, ...]
    effects: tuple[EffectInstance, ...] = ()
    robot: str | None = None
    conditions: Mapping[str, Any] = field(default_factory=dict)
    raw: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def result(self, name: str) -> Quantity:
        """Return the result of a name. Raises UserError: no such result."""
        for quantity in self.results:
            if quantity.quantity == name:
                return quantity
        raise UserError("no such quantity", got=name, choices=[q.quantity for q in self.results])


def _example(folder: Path) -> Path:
    row = BudgetRow("angle at 3 places", "A", 0.011, 2.0, 1.09, 0.012)
    mu = Quantity("static_friction", 0.31, "1", 0.012, 2.0, 4.30265, 0.258, 0.362, "gum", (row,), 10)
    scale, origin = Value(1.03, 0.86, 1.21), {"measured": "friction"}
    friction = EffectInstance("contact_friction", "fixture", {"scale": scale}, origin)
    path = folder / "measurement.yaml"
    path.write_text(measurement_text(Measurement("friction", "fixture", (mu,), (friction,))), encoding="utf-8")
    return path


@enrol(FORMAT, _example)
def load_measurement(path: str | Path) -> Measurement:
    """Read a measurement file.

    Raises:
        UserError: an unreadable file, another format, or a wrong number, unit, place or key; it names file and key.
    """
    data = MEASUREMENT.read(path)
    text = {key: _text(data.get(key, ""), path, key) for key in ("protocol", "of")}
    robot = data.get("robot")
    if robot is not None and (not isinstance(robot, str) or not robot):
        raise UserError("wrong robot", file=path, key="robot", expected="a name or a path", got=robot)
    robot = robot and located(robot, Path(path))
    results = typed(tuple[Quantity, ...], data["results"], path, "results")
    if not results:
        raise UserError("is empty", file=path, key="results", expected="one result or more")
    for i, quantity in enumerate(results):
        if any(not math.isfinite(row.contribution) or row.contribution < 0 for row in quantity.budget):
            raise UserError("a negative contribution", file=path, key=f"results[{i}].budget")
    entries = data.get("effects") or []
    if not isinstance(entries, list):
        raise UserError("wrong effects", file=path, key="effects", expected="a list", got=type(entries).__name__)
    effects = tuple(read_placed(entry, Path(path), f"effects[{i}]") for i, entry in enumerate(entries))
    tables = {key: _mapping(data.get(key) or {}, path, key) for key in ("conditions", "raw", "details", "provenance")}
    notes = data.get("notes") or []
    if not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        raise UserError("wrong notes", file=path, key="notes", expected="a list of text", got=notes)
    return Measurement(text["protocol"], text["of"], results, effects, robot, notes=tuple(notes), **tables)


def is_measurement(path: str | Path) -> bool:
    """Return whether a YAML file states the format of a measurement. Raises UserError: it cannot be read."""
    data = read_yaml(path)
    return isinstance(data, dict) and data.get("format") == FORMAT


def measurement_text(measurement: Measurement) -> str:
    """Return the text of a measurement's file, the inverse of `load_measurement`."""
    return yaml.dump(measurement_data(measurement), Dumper=Plain, sort_keys=False, allow_unicode=True, width=120)


def measurement_data(measurement: Measurement) -> dict[str, object]:
    """Return a measurement as plain data, as in its file."""
    data: dict[str, object] = {"format": FORMAT, "protocol": measurement.protocol, "of": measurement.of}
    data |= {"robot": measurement.robot} if measurement.robot else {}
    data["results"] = [_plain(asdict(quantity)) for quantity in measurement.results]
    data["effects"] = [placed_dict(instance) for instance in measurement.effects]
    for key in ("conditions", "raw", "notes", "details", "provenance"):
        if value := getattr(measurement, key):
            data[key] = _plain(value)
    return data


def _plain(value: Any) -> Any:
    """Return data for YAML, with lists in place of tuples and Python's numbers in place of NumPy's."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return value


def _text(value: Any, path: str | Path, key: str) -> str:
    if not isinstance(value, str):
        raise UserError("has the wrong type", file=path, key=key, expected="text", got=value)
    return value


def _mapping(value: Any, path: str | Path, key: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise UserError("has the wrong type", file=path, key=key, expected="a mapping", got=value)
    return value
