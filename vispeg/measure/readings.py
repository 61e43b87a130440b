"""Readings of instruments from a table, in SI units, with the instruments' resolution and accuracy."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy import stats

from vispeg.core.errors import UserError
from vispeg.measure.uncertainty import Input, rectangular
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.tables.table import MAX_ROWS, Table

# end of a column's name -> unit in SI, factor to it
SUFFIXES = {
    "_deg": ("rad", np.pi / 180.0),
    "_g": ("kg", 1e-3),
    "_mm": ("m", 1e-3),
    "_cm": ("m", 1e-2),
    "_ms": ("s", 1e-3),
}
REPEATS_AGREE = 3.0  # standard uncertainties by which readings of one quantity may differ


@dataclass(frozen=True)
class Readings:
    """A table of readings.

    Attributes:
        file: the table, or the first of several recordings.
        columns: name without its unit -> (n,) in SI units.
        resolution: name -> one digit of the instrument, SI.
        accuracy: name -> limit of the instrument's error, SI.
        numbers: number of each reading in messages, as `Table.numbers`; by default its line in a text table, whose
            line 1 is the header.
        titles: name -> the column's name in the table, with its unit; empty for readings of no table.
    """

    file: Path
    columns: Mapping[str, np.ndarray]
    resolution: Mapping[str, float] = field(default_factory=dict)
    accuracy: Mapping[str, float] = field(default_factory=dict)
    numbers: range | np.ndarray = range(2, 2 + MAX_ROWS)
    titles: Mapping[str, str] = field(default_factory=dict)

    def row(self, index: int | np.integer) -> str:
        """Name a reading in messages by its row in the table."""
        return f"row {int(self.numbers[int(index)])}"

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def __getitem__(self, name: str) -> np.ndarray:
        return self.columns[name]

    def place(self) -> np.ndarray | None:
        """Return the column `place`, (n,): the number of the spot at which each reading was taken; None without one."""
        return self.columns.get("place")

    def instrument(self, name: str) -> list[Input]:
        """Return the instrument's errors of a column: half a digit, and the instrument's limit of error.

        Each has the value 0 and is left out if its uncertainty is 0.

        Raises:
            UserError: the resolution is not stated.
        """
        out = [rectangular(f"resolution of {name}", 0.5 * self.digit(name))]
        if self.accuracy.get(name):
            out.append(rectangular(f"limit of error of {name}", self.accuracy[name]))
        return [error for error in out if error.u > 0]

    def digit(self, name: str) -> float:
        """Return one digit of the instrument of a column, SI.

        Raises:
            UserError: the resolution is not stated.
        """
        if name not in self.resolution:
            title = self.titles.get(name, name)
            expected = f"--resolution {title}=ONE DIGIT (0 if it is negligible)"
            raise UserError(f"the resolution of '{title}' is not stated", file=self.file, expected=expected)
        return self.resolution[name]


def read(file: Path, resolution: Iterable[str], accuracy: Iterable[str]) -> Readings:
    """Read the readings in a .csv, .csv.gz or .parquet table.

    Args:
        file: columns with the names of the protocol, in SI, or with a unit at the end (`angle_deg`, `mass_g`, `h1_mm`).
        resolution: texts `NAME=NUMBER` with one digit of the instrument, in the unit that NAME ends with or, without
            one, in SI.
        accuracy: the same for the limit of error.

    Raises:
        UserError: an empty cell or one that is not a number, a column twice, or as `of_instruments`.
    """
    table = read_table(file)
    columns: dict[str, np.ndarray] = {}
    titles: dict[str, str] = {}
    for full in table.names:
        name, factor, _ = bare(full)
        titles[name] = full
        if name in columns:
            raise UserError("the same column in two units", file=file, key=full)
        columns[name] = factor * _complete(table, full)
    return of_instruments(Readings(file, columns, numbers=table.numbers, titles=titles), resolution, accuracy)


def of_instruments(readings: Readings, resolution: Iterable[str], accuracy: Iterable[str]) -> Readings:
    """Return the readings with the stated resolution and accuracy of instruments, replacing those of these columns.

    Raises:
        UserError: an unknown name, one that is stated twice, a unit of another quantity than that of the column's
            title, or a number below 0.
    """
    digit, limit = (
        _settings(flag, texts, readings) for flag, texts in (("resolution", resolution), ("accuracy", accuracy))
    )
    return replace(readings, resolution={**readings.resolution, **digit}, accuracy={**readings.accuracy, **limit})


def bare(name: str) -> tuple[str, float, str]:
    """Split a column's name into the name without its unit, factor to SI, and unit in SI.

    `angle_deg` is angle, 0.01745, rad; `angle` is angle, 1, "", as a name without a unit does not say its own.
    """
    for suffix, (unit, factor) in SUFFIXES.items():
        if name.endswith(suffix) and len(name) > len(suffix):
            return name[: -len(suffix)], factor, unit
    return name, 1.0, ""


def choose(readings: Readings, forms: Mapping[str, Sequence[str]]) -> str:
    """Return the form of a table: the first of `forms` (name -> columns) whose columns all exist.

    Raises:
        UserError: no form fits; it lists the columns of each.
    """
    for form, columns in forms.items():
        if all(column in readings.columns for column in columns):
            return form
    expected = " or ".join(f"columns {', '.join(columns)} ({form})" for form, columns in forms.items())
    raise UserError(
        "is not a table of this protocol", file=readings.file, expected=expected, got=", ".join(readings.columns)
    )


def instrument_law(
    readings: Readings, names: Sequence[str], function: Callable[..., float]
) -> tuple[list[Input], Callable[..., float]]:
    """Write a function of mean readings as a function of the instruments' errors.

    Args:
        readings: the table.
        names: columns that are the function's arguments, in order.
        function: of the readings.

    Returns:
        (errors, law): inputs of value 0, and `law(*errors)` = function(mean readings + errors).
    """
    errors = [(name, error) for name in names for error in readings.instrument(name)]
    at = {name: float(readings[name].mean()) for name in names}

    def law(*off: float) -> float:
        shifted = dict(at)
        for (name, _), shift in zip(errors, off, strict=True):
            shifted[name] = shifted[name] + shift
        return function(*shifted.values())

    return [error for _, error in errors], law


def digit_of(readings: Readings, names: Sequence[str], function: Callable[..., float]) -> float:
    """Return how much a function of mean readings changes if each column changes by one digit of its instrument.

    The changes by different columns are independent: the result is the root of the sum of their squares.

    Args:
        readings: the table.
        names: columns that are the function's arguments, in order.
        function: of the readings.

    Raises:
        UserError: the resolution of a column is not stated.
    """
    at = [float(readings[name].mean()) for name in names]
    halves = np.diag([0.5 * readings.digit(name) for name in names])
    return float(np.linalg.norm([function(*(at + half)) - function(*(at - half)) for half in halves]))


def refuse_drift(values: np.ndarray, resolution: float, file: Path, named: str) -> None:
    """Raise UserError if readings (n,) of one quantity drift, that is rise or fall by more than chance allows.

    They drift if the first and the last differ by more than the scatter of those between explains, or if a line through
    all has a significant slope. With fewer than five readings nothing is tested. The scatter is at least that of the
    instrument's digit. Of readings with normal errors and no drift 0.5 % are refused, 0.27 % by each test: at half that
    level, five readings would have to be 1.4 times as far apart.

    Args:
        values: in the order in which they were taken.
        resolution: one digit of the instrument, in the same unit.
        file, named: the table and the quantity's name, for the error.
    """
    n = len(values)
    if n < 5:
        return
    digit = resolution / np.sqrt(12.0)
    tail = stats.norm.sf(REPEATS_AGREE)  # Student's quantile has this probability, as the scatter of few is uncertain
    # a difference of two readings has sqrt(2) times their scatter; the n - 2 others tell it by n - 3 degrees of freedom
    ends_scatter = np.sqrt(2.0) * np.hypot(np.std(values[1:-1], ddof=1), digit)
    ends_most = float(stats.t.isf(tail, n - 3) * ends_scatter)
    time = np.arange(n) - 0.5 * (n - 1)
    slope = float(time @ values / (time @ time))
    about_line = values - values.mean() - slope * time
    scatter = np.hypot(np.sqrt(about_line @ about_line / (n - 2)), digit)
    rise_scatter = (n - 1) * scatter / np.sqrt(time @ time)  # of the line's rise from the first reading to the last
    rise_most = float(stats.t.isf(tail, n - 2) * rise_scatter)
    rounding = 1e-9 * abs(float(values.mean()))  # the subtraction of a tare is not exact
    for moved, most, what in (
        (abs(float(values[-1] - values[0])), ends_most, "the first reading of {} and its repeat at the end disagree"),
        (abs(slope) * (n - 1), rise_most, "the readings of {} rise or fall evenly"),
    ):
        if moved > max(most, rounding):
            expected = f"a difference under {most:.3g}"
            raise UserError(f"{what.format(named)}: it drifts", file=file, expected=expected, got=moved)


def _complete(table: Table, name: str) -> np.ndarray:
    values = table.number(name)
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        got = "an empty cell" if np.isnan(values[bad[0]]) else "infinity"
        raise UserError("a reading is missing", file=table.file, key=f"{table.row(bad[0])}, column {name}", got=got)
    return values


def _settings(flag: str, texts: Iterable[str], readings: Readings) -> dict[str, float]:
    out: dict[str, float] = {}
    for text in texts:
        full, _, number = text.partition("=")
        name, factor, unit = bare(full)
        if name not in readings.columns:
            choices = [readings.titles.get(column, column) for column in readings.columns]
            raise UserError("no such column", file=readings.file, key=f"--{flag}", got=full, choices=choices)
        title = readings.titles.get(name, name)
        of_column = bare(title)[2]
        if unit and of_column and unit != of_column:
            choices = [name + suffix for suffix, (si, _) in SUFFIXES.items() if si == of_column]
            what = f"no unit of the column {title}"
            raise UserError(what, file=readings.file, key=f"--{flag}", got=full, choices=[name, *choices])
        try:
            value = float(number)
        except ValueError:
            value = -1.0
        if not 0 <= value < np.inf:
            raise UserError("not a size", key=f"--{flag} {full}", expected="NAME=NUMBER, 0 or more", got=text)
        if name in out:
            raise UserError("is stated twice", file=readings.file, key=f"--{flag}", got=full)
        out[name] = factor * value
    return out
