"""Measured motion and torque against the model, before and after, joint by joint, on held-out recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.core.lines import thin
from vispeg.diagnosis.traces import Trace
from vispeg.report.drawings.figures import AFTER, BEFORE, MEASURED, MUTED, Shape, chart, legend, new_figure, quiet
from vispeg.report.live import arm
from vispeg.report.live.arm import stage
from vispeg.report.live.traces import SCRIPTS as CHARTS
from vispeg.report.live.traces import STYLES as CHART_STYLES
from vispeg.report.live.traces import Line, Panel, Track, inert, widget
from vispeg.report.record import Record
from vispeg.report.text import words
from vispeg.report.text.quantities import prefix, quantity, rms

if TYPE_CHECKING:
    from matplotlib.figure import Figure


TITLE = "Measured against model"
SCRIPTS, STYLES = (*CHARTS, *arm.SCRIPTS), CHART_STYLES
MOST_TRACES, MOST_TRACKS = 3, 8  # traces drawn in print; tracks to choose from on screen
POINTS, NARROW_POINTS = 20_000, 160  # in print: in total, and per line on a narrow page
SHARE = 0.15  # share of the worst joint's residual below which joints are hidden at first
SHOWN, LARGEST = 0.3, 500  # the largest joint error is magnified to SHOWN rad on the page, at most LARGEST times

WHAT = {"rad": "motion", "px": "motion", "N m": "torque", "N": "force"}  # unit of a trace -> quantity in words


def context(record: Record) -> Mapping[str, object]:
    """Return a picture and a sentence for each of the worst held-out recordings, and a table with all of them."""
    traces = [*record.evidence.traces, *record.evidence.torques]
    ordered = sorted(record.evidence.traces, key=lambda t: -(_final(t) or 0.0))[:MOST_TRACES]
    names = {t.name for t in ordered}
    chosen = [t for t in traces if t.name in names][: 2 * MOST_TRACES]
    lines = max(1, sum(5 * t.measured.shape[1] for t in chosen))  # of each joint three signals and two residuals
    points = int(min(1500, max(160, POINTS / lines)))
    joints = record.evidence.joints
    return {
        "still": not record.evidence.traces,
        "plot": interactive(record) if record.evidence.traces else None,
        "arm": arm_stage(record.evidence.arm, _worst_first(record), joints),
        "pictures": [
            {"svg": trace_picture(t, joints, f"trace{i}", points), "title": trace_title(t, joints)}
            for i, t in enumerate(chosen)
        ],
        "table": [_row(t) for t in traces],
        "joints": joints,
        "hidden": len(record.evidence.traces) - len(ordered),
        "held_out": record.kind == "diagnosis" or (record.kind == "fit" and record.values.get("judged") != "fitted"),
    }


def interactive(record: Record) -> dict[str, object]:
    """Return the data for interactive plots of signals and residuals, the worst recording first."""
    evidence = record.evidence
    worst, torques = _worst_first(record), {t.name: torque for t, torque in evidence.pairs}
    tracks = [Track(t.name, t.time, _arrays(t) | _arrays(torques[t.name], "_tau")) for t in worst]
    size = np.sqrt(sum(np.nansum((t.before - t.measured) ** 2, axis=0) for t in worst))
    visible = [bool(s >= SHARE * size.max(initial=0.0)) for s in size]
    last = "model" if worst[0].after is None else "model after"
    panels = _panels(evidence.unit, "", last) + (_panels("N m", "_tau", last) if evidence.torques else ())
    return widget(evidence.joints, panels, tracks, visible)


def _worst_first(record: Record) -> list[Trace]:
    """Return at most MOST_TRACKS traces by decreasing residual of the last model."""
    return sorted(record.evidence.traces, key=lambda t: -(_final(t) or 0.0))[:MOST_TRACKS]


def _arrays(trace: Trace | None, suffix: str = "") -> dict[str, np.ndarray]:
    """Return the measured values and each model's residuals, which are encoded separately so that they stay exact."""
    if trace is None:
        return {}
    arrays = {f"measured{suffix}": trace.measured, f"before{suffix}": trace.measured - trace.before}
    if trace.posture is not None and not suffix:
        arrays["posture"] = trace.posture
    return arrays if trace.after is None else arrays | {f"after{suffix}": trace.measured - trace.after}


def _panels(unit: str, suffix: str, last: str) -> tuple[Panel, Panel]:
    """Return the panels of signals and of residuals; `last` is the label of the final model."""
    name = WHAT.get(unit, "signal")
    first = last if last == "model" else "model before"
    models = [(first, f"before{suffix}", "before", False)]
    models += [(last, f"after{suffix}", "after", True)] if last != first else []
    signals = [Line("measured", f"measured{suffix}", "ink", width=2.0)]
    signals += [Line(label, f"measured{suffix}", colour, minus=key, dash=dash) for label, key, colour, dash in models]
    residuals = [Line(label, key, colour) for label, key, colour, _ in models]
    visible = not suffix
    return Panel(name, unit, tuple(signals), visible), Panel(f"{name} residual", unit, tuple(residuals), visible)


def trace_title(trace: Trace, joints: tuple[str, ...]) -> str:
    """Return a sentence on the change of a recording's residual, and on the joint with the largest residual left."""
    before, final = rms(trace.before - trace.measured), _final(trace)
    if before is None or final is None:
        return f"{trace.name}: no residual (the model has no finite prediction)"
    what = "torque residual" if trace.unit == "N m" else "residual"
    end = trace.before if trace.after is None else trace.after
    worst = _worst(end - trace.measured, joints, trace.unit)
    if trace.after is None:
        return f"{trace.name}: {what} {quantity(before, trace.unit)} RMS; largest at {worst}"
    moved = words.change(before, final) or "stays"
    return (
        f"{trace.name}: {what} {moved}, {quantity(before, trace.unit)} to {quantity(final, trace.unit)} RMS; "
        f"largest left at {worst}"
    )


def trace_picture(trace: Trace, joints: tuple[str, ...], name: str, points: int) -> str:
    """Return SVG with, per joint, signals on the left (or above) and residuals on the right (or below)."""

    def draw(shape: Shape) -> Figure:
        return trace_figure(trace, joints, min(points, NARROW_POINTS) if shape.narrow else points, shape)

    return chart(draw, name, trace_title(trace, joints))


def trace_figure(trace: Trace, joints: tuple[str, ...], points: int, shape: Shape) -> Figure:
    """Draw measured values and both models on the left, the models' residuals on the right, a row per joint or axis."""
    n, columns = len(joints), 1 if shape.narrow else 2
    figure = new_figure(0.75 + 1.84 * n / columns, shape.width)
    grid = figure.subplots(2 * n // columns, columns, sharex=True, squeeze=False).reshape(n, 2)
    for j, (left, right) in enumerate(grid):
        for values, colour, width, style in (
            (trace.measured, MEASURED, 2.4, "-"),  # wide and at the back, so that it is visible under the models
            (trace.before, BEFORE, 1.0, "-"),
            (trace.after, AFTER, 1.0, (0, (5, 3))),
        ):
            if values is not None:
                left.plot(*thin(trace.time, values[:, j], points), color=colour, lw=width, ls=style)
        _residuals(right, trace, j, points)
        left.set_title(f"{joints[j]} ({trace.unit})", color=MEASURED, pad=3)
        for ax in (left, right):
            quiet(ax)
            ax.locator_params(axis="y", nbins=4)
    for ax in grid[-1][-columns:]:
        ax.set_xlabel("time (s)")
    entries = {"measured": (MEASURED, "-"), "model" if trace.after is None else "model before": (BEFORE, "-")}
    if trace.after is not None:
        entries["model after"] = (AFTER, "-")
    legend(figure, entries)
    return figure


def _residuals(ax: Any, trace: Trace, j: int, points: int) -> None:
    before = trace.measured[:, j] - trace.before[:, j]
    after = None if trace.after is None else trace.measured[:, j] - trace.after[:, j]
    finite = before[np.isfinite(before)]
    factor, unit = prefix(float(np.max(np.abs(finite))) if finite.size else None, trace.unit)
    ax.axhline(0.0, color=MUTED, linewidth=0.6)
    ax.plot(*thin(trace.time, factor * before, points), color=BEFORE, linewidth=0.9)
    text = quantity(rms(before), trace.unit)
    if after is not None:
        ax.plot(*thin(trace.time, factor * after, points), color=AFTER, linewidth=0.9)
        text = f"{text} → {quantity(rms(after), trace.unit)}"
    ax.set_title(f"residual ({unit})", color=MUTED, pad=3)
    ax.set_title(f"RMS {text}", loc="right", color=MEASURED, pad=3)


def _row(trace: Trace) -> Mapping[str, object]:
    cells = []
    for j in range(trace.measured.shape[1]):
        before = rms(trace.before[:, j] - trace.measured[:, j])
        after = None if trace.after is None else rms(trace.after[:, j] - trace.measured[:, j])
        cells.append((quantity(before, trace.unit), None if trace.after is None else quantity(after, trace.unit)))
    total = quantity(rms(trace.before - trace.measured), trace.unit)
    last = None if trace.after is None else quantity(_final(trace), trace.unit)
    return {"name": trace.name, "what": WHAT.get(trace.unit, "signal"), "cells": [*cells, (total, last)]}


def _final(trace: Trace) -> float | None:
    """Return the RMS residual of the last model."""
    return rms((trace.before if trace.after is None else trace.after) - trace.measured)


def _worst(residual: np.ndarray, joints: tuple[str, ...], unit: str) -> str:
    size = [rms(residual[:, j]) or 0.0 for j in range(residual.shape[1])]
    j = int(np.argmax(size))
    return f"{joints[j]} ({quantity(size[j], unit)} RMS)"


@dataclass(frozen=True)
class Worst:
    """The largest error of a model: time, s; norm over all joints (`size`); and a description with the worst joint."""

    time: float
    words: str
    size: float


def moment(trace: Trace, joints: Sequence[str]) -> Worst:
    """Return the moment of the given model's largest error in a recording."""
    off = np.nan_to_num(np.abs(trace.measured - trace.before), posinf=0.0)
    k = int(np.argmax(np.linalg.norm(off, axis=1)))
    j = int(np.argmax(off[k]))
    size = quantity(float(off[k, j]), trace.unit)
    words = f"{trace.name} at {trace.time[k]:.2f} s, where {joints[j]} is off by {size}"
    return Worst(round(float(trace.time[k]), 4), words, float(np.linalg.norm(off[k])))


def arm_stage(
    arm: Mapping[str, np.ndarray], traces: Sequence[Trace], joints: Sequence[str]
) -> dict[str, object] | None:
    """Return the values for the template `stage.html.j2`, which shows the arm; None without an arm or traces."""
    if not arm or not traces:
        return None
    worst = [moment(t, joints) for t in traces]
    track = int(np.argmax([w.size for w in worst]))
    angles = traces[0].unit == "rad"
    ghosts = [("before", "model before" if traces[0].after is not None else "model", True)]
    ghosts += [("after", "model after", False)] if traces[0].after is not None else []
    most = max(float(np.nanmax(np.abs(t.measured - t.before), initial=0.0)) for t in traces)
    data = stage(arm) | {"worst": [asdict(w) for w in worst], "first": {"track": track, "time": worst[track].time}}
    return {
        "data": inert(data),
        "words": worst[track].words,
        "ghosts": ghosts if angles else [],
        "enlarged": int(np.clip(SHOWN / max(most, 1e-9), 1, LARGEST)) if angles else 1,
        "most": LARGEST,
    }
