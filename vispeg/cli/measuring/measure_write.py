"""A measurement's file, and the table that a person reads."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from vispeg.cli.measuring.measure_stop import Stop
from vispeg.cli.output import Output
from vispeg.core.errors import UserError

if TYPE_CHECKING:
    from vispeg.worlds.measurement_file import Measurement, Quantity


def check_out(out: Path, overwrite: bool) -> None:
    """Raises UserError for a name that no measurement can have, before anything is worked out."""
    if out.suffix.lower() not in (".yaml", ".yml"):
        raise UserError("not a measurement file", key="--out", expected="a name that ends in .yaml", got=str(out))
    if out.exists() and not overwrite:
        raise UserError("exists already; name another or pass --overwrite", file=out)
    if out.is_file():
        from vispeg.worlds.measurement_file import load_measurement

        load_measurement(out)  # what is no measurement is not replaced


def conditions(texts: Iterable[str]) -> dict[str, str]:
    """`NAME=TEXT` pairs. Raises UserError for others."""
    out = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise UserError("not a condition", key="--conditions", expected="NAME=TEXT", got=text)
        out[name] = value
    return out


def complete(measurement: Measurement, inputs: Sequence[Path], seed: int) -> Measurement:
    """With the readings' hashes, the command and the versions."""
    from vispeg.core.provenance import provenance

    origin = provenance(sys.argv, seed, inputs)
    raw = origin.pop("inputs")
    return replace(measurement, raw=raw, provenance=origin)


def write(measurement: Measurement, out: Path, inputs: Sequence[Path], seed: int, overwrite: bool) -> Measurement:
    """Writes OUT; gives what was written."""
    from vispeg.core.files import write_text_atomic
    from vispeg.worlds.measurement_file import measurement_text

    full = complete(measurement, inputs, seed)
    write_text_atomic(out, measurement_text(full), overwrite=overwrite)
    return full


def tell(full: Measurement, file: Path, stop: Stop, output: Output, said: str, budget: bool = True) -> None:
    """Prints what was measured; then, where policies are named, plays them and says whether that is enough.

    Args:
        full: as it stands in `file`.
        stop: the policies, and how they are played.
        output: as JSON, once all is known, or as text as it comes.
        said: the last line on the measurement: what was written.
        budget: whether the sources of the first number's uncertainty are shown.
    """
    import yaml

    from vispeg.worlds.measurement_file import measurement_text

    if not output.json:
        show(full, budget)
        print(said)
    if stop.policy:
        from vispeg.cli.measuring.measure_stop import enough

        full, lines = enough(full, file, stop, output.quiet)
        for line in lines:
            output.line(line)
    if output.json:
        output.give(yaml.safe_load(measurement_text(full)), [])


def show(measurement: Measurement, budget: bool = True) -> None:
    """A row a number; below it, with `budget`, the sources of the first one's uncertainty; the effects; the notes."""
    from rich.markup import escape

    from vispeg.report.text.tables import Column, Sheet, terminal

    console = terminal()
    heads = [
        Column("quantity"),
        *(Column(h, right=True) for h in ("value", "u", "95 % interval", "dof")),
        Column("unit"),
    ]
    console.print(Sheet(heads, [row(q) for q in measurement.results]))
    first = measurement.results[0]
    if budget and first.budget:
        total = sum(b.contribution**2 for b in first.budget) or 1.0
        rows = [
            [b.source, b.type, f"{b.contribution:.2g}", f"{100 * b.contribution**2 / total:.0f} %"]
            for b in first.budget
        ]
        columns = [Column(f"budget of {first.quantity}", prose=True), Column("type"), Column("u", right=True)]
        console.print(Sheet([*columns, Column("share", right=True)], rows))
    for placed in measurement.effects:
        values = ", ".join(
            f"{k} {v.value:.4g}" + ("" if v.low is None else f" [{v.low:.4g}, {v.high:.4g}]")
            for k, v in placed.params.items()
        )
        console.print(f"becomes {escape(placed.label)}: {values}", soft_wrap=True, highlight=False)
    for note in measurement.notes:
        console.print(f"  [yellow]![/yellow] {escape(note)}", soft_wrap=True, highlight=False)


def row(q: Quantity) -> list[str]:
    """The cells of one number."""
    dof = "inf" if q.dof is None else f"{q.dof:.3g}"
    return [q.quantity, f"{q.value:.5g}", f"{q.u:.2g}", f"{q.low:.5g} to {q.high:.5g}", dof, q.unit]
