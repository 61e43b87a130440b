"""The section on the wrench at the wrist: measured and modelled over time with the contact phase; the worst moment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from vispeg.diagnosis.traces import Trace
from vispeg.report.drawings.figures import AFTER, BEFORE, MEASURED, Shape, chart, legend, new_figure, quiet
from vispeg.report.drawings.palette import day
from vispeg.report.record import Record, data_link
from vispeg.report.text.quantities import plain, quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TITLE = "Wrench, measured against model"
MOST = 3  # most recordings drawn
AXES = "xyz"
PHASES = tuple(map(day, ("pale", "lagoon", "violet", "sand", "wine")))  # in the order of their names


def context(record: Record) -> Mapping[str, object] | None:
    """Return a figure per recording, errors by phase, the worst moment, effects not excited; None without contact."""
    if record.values.get("evidence") != "contact":
        return None
    evidence = record.evidence
    names = [str(n) for n in evidence.phase_names]
    pairs = [(force, torque) for force, torque in evidence.pairs if torque is not None][:MOST]
    return {
        "pictures": [
            {"svg": _picture(force, torque, names, i), "title": force.name} for i, (force, torque) in enumerate(pairs)
        ],
        "hidden": len(evidence.traces) - len(pairs),
        "phases": [
            {"phase": str(row.get("phase")), "seconds": plain(row.get("seconds")),
             "floor": quantity(row.get("floor"), "N"), "before": quantity(row.get("before"), "N"),
             "after": quantity(row.get("after"), "N") if row.get("after") is not None else ""}
            for row in record.rows("phases")
        ],
        "worst": "" if evidence.worst is None else data_link(evidence.worst),
        "moment": evidence.worst_moment,
        "silent": record.rows("not_excited"),
        "replayed": [
            {"recording": row["recording"], "run": name, "peak": quantity(trial["peak_force"], "N"),
             "contact": quantity(trial["contact_s"], "s"), "outcome": trial["outcome"]}
            for row in record.rows("closed_loop") for name, trial in row["trials"].items()
        ],
        "held_out": record.kind == "diagnosis",
    }  # fmt: skip


def _picture(force: Trace, torque: Trace, names: list[str], i: int) -> str:
    codes = np.zeros(len(force.time), int) if force.regime is None else force.regime
    return chart(lambda shape: _figure(force, torque, codes, names, shape), f"wrench{i}", f"Wrench of {force.name}")


def _figure(force: Trace, torque: Trace, codes: np.ndarray, names: list[str], shape: Shape) -> Figure:
    figure = new_figure(6.2 if shape.narrow else 6.8, shape.width)
    heights = [1.0] * 6 + [0.45]  # three forces, three torques, the phases
    axes = figure.subplots(len(heights), 1, sharex=True, gridspec_kw={"height_ratios": heights})
    for k, (trace, unit) in enumerate(((force, "N"), (torque, "N m"))):
        for j, axis in enumerate(AXES):
            ax = axes[3 * k + j]
            for values, colour, width in ((trace.before, BEFORE, 1.2), (trace.after, AFTER, 1.2)):
                if values is not None:
                    ax.plot(trace.time, values[:, j], color=colour, linewidth=width)
            ax.plot(trace.time, trace.measured[:, j], color=MEASURED, linewidth=0.7)
            ax.set_ylabel(f"{'F' if k == 0 else 'T'}{axis} ({unit})")
            quiet(ax)
    _band(axes[6], force.time, codes)
    axes[6].set_xlabel("time (s)")
    figure.align_ylabels(axes)
    entries = {"measured": (MEASURED, "-"), "initial model": (BEFORE, "-")}
    if force.after is not None:
        entries["corrected model"] = (AFTER, "-")
    entries |= {names[k]: (PHASES[k % len(PHASES)], "s") for k in range(len(names)) if np.any(codes == k)}
    legend(figure, entries)
    return figure


def _band(ax: Axes, time: np.ndarray, codes: np.ndarray) -> None:
    """Draw the contact phases as coloured stretches; the legend names them, as many are too short for text."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    for part in np.split(np.arange(len(codes)), np.flatnonzero(np.diff(codes)) + 1):
        left, right = float(time[part[0]]) - step / 2, float(time[part[-1]]) + step / 2
        ax.axvspan(left, right, color=PHASES[int(codes[part[0]]) % len(PHASES)], linewidth=0)
    ax.set_yticks([])
    ax.set_ylabel("phase")
