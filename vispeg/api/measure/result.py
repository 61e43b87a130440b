"""Settings and result of a measurement."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.core.provenance import provenance
from vispeg.report.text.summary import Block, Line, Summarised
from vispeg.report.text.tables import Column, Sheet
from vispeg.worlds.identified import constant, without_interval
from vispeg.worlds.measurement_file import (
    Measurement,
    Quantity,
    load_measurement,
    measurement_data,
    measurement_text,
)


@dataclass(frozen=True)
class MeasureSettings:
    """Settings of every measurement.

    Attributes:
        resolution: smallest digit of the instrument for each column, such as angle_deg=0.1 mass_g=1.
        accuracy: limit of the instrument's error for each column, such as mass_g=2; default: no limit is considered.
        conditions: conditions to record in the file, such as surface=steel temperature=21.
        seed: seed of the Monte Carlo propagation.
        overwrite: replace `out` if it exists.
    """

    resolution: Sequence[str] = ()
    accuracy: Sequence[str] = ()
    conditions: Mapping[str, str] | None = None
    seed: int = 0
    overwrite: bool = False


@dataclass(frozen=True)
class MeasurementResult(Summarised):
    """A measurement on disk.

    Attributes:
        measurement: the measured quantities, and the corresponding effects of a model.
        file: the measurement file.
        written: a line of text on what was written.
        budget: whether `summary` shows the uncertainty budget of the first quantity.
    """

    measurement: Measurement
    file: Path
    written: str
    budget: bool = True

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg measure .. --json`: the file as plain data."""
        return measurement_data(self.measurement)

    @property
    def summary(self) -> list[Block]:
        """One row per quantity, the uncertainty budget of the first, the effects, and the notes."""
        m = self.measurement
        heads = [Column("quantity"), *(Column(h, right=True) for h in ("value", "u", "95 % interval", "dof"))]
        out: list[Block] = [Sheet([*heads, Column("unit")], [row(q) for q in m.results])]
        if self.budget and m.results[0].budget:
            out.append(budget_of(m.results[0]))
        for effect in m.effects:
            values = ", ".join(
                f"{k} {v.value:.4g}" + ("" if v.low is None else f" [{v.low:.4g}, {v.high:.4g}]")
                for k, v in effect.params.items()
            )
            out.append(Line(f"becomes {effect.label}: {values}", path=True))
            if names := without_interval(effect):
                out.append(Line(constant(effect, names), warning=True))
        out += [Line(note, warning=True) for note in m.notes]
        return [*out, Line(self.written, path=True)]


def row(q: Quantity) -> list[str]:
    """Return the table cells of a quantity."""
    dof = "inf" if q.dof is None else f"{q.dof:.3g}"
    return [q.quantity, f"{q.value:.5g}", f"{q.u:.2g}", f"{q.low:.5g} to {q.high:.5g}", dof, q.unit]


def budget_of(q: Quantity) -> Sheet:
    """Return the uncertainty budget of a quantity: sources with their shares."""
    total = sum(b.contribution**2 for b in q.budget) or 1.0
    rows = [[b.source, b.type, f"{b.contribution:.2g}", f"{100 * b.contribution**2 / total:.0f} %"] for b in q.budget]
    columns = [Column(f"budget of {q.quantity}", prose=True), Column("type"), Column("u", right=True)]
    return Sheet([*columns, Column("share", right=True)], rows)


def check_out(out: Path, overwrite: bool) -> None:
    """Check, before measuring, that `out` can be written; raise UserError otherwise."""
    if out.suffix.lower() not in (".yaml", ".yml"):
        raise UserError("not a measurement file", key="--out", expected="a name that ends in .yaml", got=str(out))
    if out.exists() and not overwrite:
        raise UserError("exists already; name another or pass --overwrite", file=out)
    if out.is_file():
        load_measurement(out)  # only a measurement file may be replaced


def complete(measurement: Measurement, inputs: Iterable[Path], seed: int) -> Measurement:
    """Return the measurement with the hashes of its inputs, the command and the versions."""
    origin = provenance(sys.argv, seed, [*inputs])
    raw = origin.pop("inputs")
    return replace(measurement, raw=raw, provenance=origin)


def write(measurement: Measurement, out: Path, inputs: Iterable[Path], settings: MeasureSettings) -> MeasurementResult:
    """Write the measurement file `out`, including its origin."""
    full = complete(measurement, inputs, settings.seed)
    write_text_atomic(out, measurement_text(full), overwrite=settings.overwrite)
    return MeasurementResult(full, out, str(out))
