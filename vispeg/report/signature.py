"""A figure of what an effect does to a signal: `vispeg effects NAME`."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.files import write_bytes_atomic
from vispeg.report.figures import AFTER, BEFORE, MEASURED, RIVALS, new_figure, quiet, styled, thin
from vispeg.report.quantities import prefix

COLOURS = (MEASURED, BEFORE, AFTER, *RIVALS)


def signature_figure(
    title: str, time: np.ndarray, lines: Mapping[str, np.ndarray], unit: str, path: Path, *, overwrite: bool = False
) -> Path:
    """Draws `lines` (name -> (n,) in `unit`) over `time` (n,) s into a PNG or SVG file, by its ending; returns `path`.

    The first line is the reference (black, on top); up to four more follow in fixed colours.

    Raises:
        UserError: another ending, more than five lines, lines of another length than `time`, or the file exists.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("png", "svg"):
        raise UserError("cannot draw into this kind of file", file=path, got=path.suffix, choices=(".png", ".svg"))
    if not 1 <= len(lines) <= len(COLOURS):
        raise UserError("cannot tell so many lines apart", expected=f"1 to {len(COLOURS)} lines", got=len(lines))
    for name, values in lines.items():
        if np.shape(values) != np.shape(time):
            raise UserError(f"line '{name}' and time differ", expected=np.shape(time), got=np.shape(values))
    stacked = np.abs(np.stack([np.asarray(values, float) for values in lines.values()]))
    factor, shown = prefix(float(np.max(stacked[np.isfinite(stacked)], initial=0.0)), unit)
    stream = BytesIO()
    with styled():
        figure = new_figure(2.9, 6.4)
        ax = figure.add_subplot()
        for i, (name, values) in enumerate(lines.items()):
            drawn = thin(np.asarray(time, float), factor * np.asarray(values, float))
            ax.plot(*drawn, color=COLOURS[i], linewidth=1.6 if i else 1.3, label=name, zorder=3 - 0.1 * i)
        ax.set(xlabel="time (s)", ylabel=shown)
        figure.suptitle(title, x=0.01, ha="left", fontsize=10, fontweight="bold")
        if len(lines) > 1:
            ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(lines), borderaxespad=0.0)
        quiet(ax)
        figure.savefig(stream, format=kind, dpi=160, metadata={"Date": None} if kind == "svg" else None)
    return write_bytes_atomic(path, stream.getvalue(), overwrite=overwrite)
