"""Draw the measurements of a joint: steps, Bode diagram with coherence, friction and lost motion over speed."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.measure.frequency import COHERENT
from vispeg.measure.steps import sizes, step_answer
from vispeg.report.drawings.figures import AFTER, BEFORE, MEASURED, MUTED, RIVALS, styled

if TYPE_CHECKING:
    from vispeg.measure.joint import Joint

SHOWN = 1.0  # s, length of a step shown


def picture(joint: str, measured: Joint) -> bytes:
    """Return a PNG of six panels; those without data say `not measured`."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullLocator

    with styled():
        figure = Figure(figsize=(11.0, 8.4), dpi=120, layout="constrained")
        axes = figure.subplots(3, 2)
        figure.suptitle(f"{joint}", x=0.01, ha="left", fontweight="bold")
        panels = [
            (_steps, "Steps, as a share of their size"),
            (_friction, "Friction: half the height of the torque loop"),
            (_gain, "Gain"),
            (_lag, "Lost motion: width of the loop of angle over command"),
            (_phase, "Phase"),
            (_coherence, "Coherence"),
        ]
        for axis, (draw, title) in zip(axes.flat, panels, strict=True):
            axis.set_title(title, fontsize=9.5)
            if not draw(axis, measured):
                axis.text(0.5, 0.5, "not measured", ha="center", va="center", color=MUTED, transform=axis.transAxes)
                axis.set_xticks([])
                axis.set_yticks([])
            elif axis.get_xscale() == "log":
                axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                axis.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
                axis.xaxis.set_minor_locator(NullLocator())
        stream = BytesIO()
        figure.savefig(stream, format="png")
    return stream.getvalue()


def _steps(axis: Any, measured: Joint) -> bool:
    if not measured.steps:
        return False
    colours = (MEASURED, BEFORE, RIVALS[0], RIVALS[1], MUTED)
    amplitudes = sizes(measured.steps)
    labelled = set()
    for step in measured.steps:
        trace = step.trace
        rows = (trace.time >= step.start - 0.05) & (trace.time < step.start + SHOWN)
        before = trace.q[(trace.time >= step.start - 0.1) & (trace.time < step.start)].mean()
        k = int(np.argmin([abs(abs(step.size) - s) for s in amplitudes]))
        label = f"{amplitudes[k]:.3g} rad" if k not in labelled and len(amplitudes) <= 5 else None
        labelled.add(k)
        y = (trace.q[rows] - before) / step.size
        axis.plot(trace.time[rows] - step.start, y, color=colours[k % 5], lw=0.6, alpha=0.6, label=label)
    if measured.servo is not None:
        t, s = np.linspace(-0.05, SHOWN, 800), measured.servo
        y = s.gain * step_answer(t - s.delay, s.natural_frequency, s.damping_ratio)
        axis.plot(t, y, color=AFTER, lw=1.6, label="fitted second order")
    axis.set_xlabel("s after the command")
    axis.legend(loc="lower right", fontsize=8)
    return True


def _points(measured: Joint) -> list[tuple[str, list[Any], str]]:
    """Return the points of each amplitude: (label, points, colour)."""
    sizes = sorted({_label(p.amplitude) for p in measured.points}, key=lambda w: (len(w), w))
    colours = (MEASURED, BEFORE, RIVALS[0], RIVALS[1])
    groups = [[p for p in measured.points if _label(p.amplitude) == size] for size in sizes]
    return [(size, points, colours[k % 4]) for k, (size, points) in enumerate(zip(sizes, groups, strict=True))]


def _label(amplitude: float) -> str:
    return f"{amplitude:.2g} rad" if amplitude else "sweep"


def _gain(axis: Any, measured: Joint) -> bool:
    for size, points, colour in _points(measured):
        used = [p for p in points if p.used]
        gain = np.array([abs(p.response) for p in used])
        u = np.array([p.u for p in used]) * 1.96 * 20 / np.log(10)  # 95 % half-width, dB
        axis.errorbar([p.hz for p in used], 20 * np.log10(gain), u, fmt="o", ms=3.5, lw=0.9, color=colour, label=size)
    if not measured.points:
        return False
    if (line := _line(measured)) is not None:
        f, response = line
        axis.plot(f, 20 * np.log10(np.abs(response)), color=AFTER, lw=1.2)
    axis.axhline(-3, color=MUTED, lw=0.7, ls=":")
    axis.set_xscale("log")
    axis.set_ylabel("dB")
    axis.legend(loc="lower left", fontsize=8)
    return True


def _phase(axis: Any, measured: Joint) -> bool:
    for _, points, colour in _points(measured):
        used = sorted((p for p in points if p.used), key=lambda p: p.hz)
        if used:
            phase = np.degrees(np.unwrap([np.angle(p.response) for p in used]))
            axis.plot([p.hz for p in used], phase, "o", ms=3.5, color=colour)
    if not measured.points:
        return False
    if (line := _line(measured)) is not None:
        f, response = line
        axis.plot(f, np.degrees(np.unwrap(np.angle(response))), color=AFTER, lw=1.2)
    axis.set_xscale("log")
    axis.set_xlabel("Hz")
    axis.set_ylabel("degrees")
    return True


def _line(measured: Joint) -> tuple[np.ndarray, np.ndarray] | None:
    """Return frequencies, Hz, with the fitted loop's response there; None without a fit or points."""
    hz = [p.hz for p in measured.points if p.used]
    if measured.servo is None or not hz:
        return None
    f = np.geomspace(min(hz), max(hz), 200)
    return f, measured.servo.response(f)


def _coherence(axis: Any, measured: Joint) -> bool:
    for _, points, colour in _points(measured):
        axis.plot([p.hz for p in points], [p.coherence for p in points], "o", ms=3.5, color=colour)
    if not measured.points:
        return False
    axis.axhspan(0, COHERENT, color=MUTED, alpha=0.12, lw=0)
    axis.text(0.02, 0.06, f"not used below {COHERENT}", color=MUTED, fontsize=8, transform=axis.transAxes)
    axis.set_xscale("log")
    axis.set_ylim(0, 1.05)
    axis.set_xlabel("Hz")
    return True


def _friction(axis: Any, measured: Joint) -> bool:
    torque = [s for s in measured.strokes if s.friction is not None]
    if not torque:
        return False
    inertia = float(str(measured.details.get("loop_inertia_kgm2", 0.0)))  # kg m2, whose torque is subtracted
    heights = [(s.friction or 0.0) - inertia * s.acceleration for s in torque]
    axis.plot([s.speed for s in torque], heights, "o", ms=3.5, color=MEASURED)
    by_name = {q.quantity: q.value for q in measured.results}
    if "coulomb_friction" in by_name:
        v = np.geomspace(min(s.speed for s in torque), max(s.speed for s in torque), 200)
        axis.plot(v, by_name["coulomb_friction"] + by_name["viscous_friction"] * v, color=AFTER, lw=1.2)
    axis.set_xscale("log")
    axis.set_ylim(bottom=min(0.0, *heights))
    axis.set_xlabel("rad/s")
    axis.set_ylabel("N m")
    return True


def _lag(axis: Any, measured: Joint) -> bool:
    moving = [s for s in measured.strokes if s.moves]
    if not moving:
        return False
    axis.plot([s.speed for s in moving], [2e3 * s.lag for s in moving], "o", ms=3.5, color=MEASURED)
    axis.set_xscale("log")
    axis.set_xlabel("rad/s")
    axis.set_ylabel("mrad")
    return True
