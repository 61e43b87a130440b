"""Draw what an effect does to a signal, for `vispeg effects NAME`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.files import write_bytes_atomic
from vispeg.core.lines import thin
from vispeg.report.drawings.figures import AFTER, BEFORE, MEASURED, RIVALS, new_figure, quiet, styled
from vispeg.report.text.quantities import prefix

COLOURS = (MEASURED, BEFORE, AFTER, *RIVALS)


def signature_panels(
    title: str,
    time: np.ndarray,
    panels: Sequence[tuple[str, Mapping[str, np.ndarray]]],
    path: Path,
    *,
    against: Mapping[str, np.ndarray] | None = None,
    overwrite: bool = False,
) -> Path:
    """Draw panels of signals one below the other over time, and return `path`.

    Args:
        title: title of the figure.
        time: (n,) time, s.
        panels: (unit, name -> values (n,)), one or more; the first line is the reference, drawn black on top of up to
            four others.
        path: a PNG or SVG file.
        against: name -> values (n,): adds a row with the last panel's first line over each of these. Friction then is
            a step over speed, a spring a line over angle, hysteresis a loop.
        overwrite: replace an existing file.

    Raises:
        UserError: another file ending, no or too many lines, a line of another length, or the file exists.
    """
    ending = path.suffix.lower().removeprefix(".")
    if ending not in ("png", "svg"):
        raise UserError("cannot draw into this kind of file", file=path, got=path.suffix, choices=(".png", ".svg"))
    for _, lines in panels:
        _check(time, lines)
    stream = BytesIO()
    with styled():
        inputs = dict(against or {})
        rows = len(panels) + bool(inputs)
        figure = new_figure(0.8 + 2.1 * rows + 0.2 * title.count("\n"), 6.4)
        grid = figure.add_gridspec(rows, max(1, len(inputs)))
        panel: Any = None
        for row, (unit, lines) in enumerate(panels):
            panel = figure.add_subplot(grid[row, :], sharex=panel)
            _panel(panel, time, unit, lines)
        panel.set_xlabel("time (s)")
        unit, lines = panels[-1]
        reference = next(iter(lines.values()))
        for column, (name, values) in enumerate(inputs.items()):
            _over(figure.add_subplot(grid[-1, column]), name, values, unit, reference)
        figure.suptitle(title, x=0.01, ha="left", fontsize=10, fontweight="bold")
        figure.savefig(stream, format=ending, dpi=160, metadata={"Date": None} if ending == "svg" else None)
    return write_bytes_atomic(path, stream.getvalue(), overwrite=overwrite)


def _check(time: np.ndarray, lines: Mapping[str, np.ndarray]) -> None:
    """Raise UserError if a panel has no or too many lines, or a line is not as long as `time`."""
    if not 1 <= len(lines) <= len(COLOURS):
        raise UserError("wrong number of lines in a panel", expected=f"1 to {len(COLOURS)} lines", got=len(lines))
    for name, values in lines.items():
        if np.shape(values) != np.shape(time):
            raise UserError(f"line '{name}' and time differ in length", expected=np.shape(time), got=np.shape(values))


def _over(ax: Any, name: str, x: np.ndarray, unit: str, y: np.ndarray) -> None:
    """Draw the signal y (n,) in `unit` over the signal x (n,) called `name`. Raises UserError: lengths differ."""
    if np.shape(x) != np.shape(y):
        raise UserError(f"'{name}' and the line over it differ in length", expected=np.shape(y), got=np.shape(x))
    factor, scaled_unit = prefix(float(np.max(np.abs(y[np.isfinite(y)]), initial=0.0)), unit)
    ax.plot(x, factor * y, color=COLOURS[0], linewidth=0.7)
    ax.set(xlabel=name, ylabel=scaled_unit)
    quiet(ax)


def _panel(ax: Any, time: np.ndarray, unit: str, lines: Mapping[str, np.ndarray]) -> None:
    """Draw lines (n,) over time, the first one on top, in `unit` with a prefix that suits the largest value."""
    stacked = np.abs(np.stack([np.asarray(values, float) for values in lines.values()]))
    factor, scaled_unit = prefix(float(np.max(stacked[np.isfinite(stacked)], initial=0.0)), unit)
    for i, (name, values) in enumerate(lines.items()):
        drawn = thin(np.asarray(time, float), factor * np.asarray(values, float))
        ax.plot(*drawn, color=COLOURS[i], linewidth=1.6 if i else 1.3, label=name, zorder=3 - 0.1 * i)
    ax.set(ylabel=scaled_unit)
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(lines), borderaxespad=0.0)
    quiet(ax)
