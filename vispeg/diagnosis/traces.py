"""Measured values and model predictions: the one type behind reports, pages, evidence.npz and notebooks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.identify.channels import Item

BESIDE = {"torque": "_tau", "moment": "_tau"}  # columns next to the principal ones -> suffix of their keys


@dataclass(frozen=True)
class Trace:
    """One kind of measured value of one stretch of a recording; arrays (n, k), a column a joint or an axis, in `unit`.

    Attributes:
        name: the recording's name, and where in it the stretch begins.
        unit: of the values.
        time: (n,) s; episodes are laid end to end.
        measured, before, after: measured, given model, final model; NaN where nothing is compared. `after` is None
            where no model was added.
        posture: (n, nj) rad, where what is compared is no angle and the angles were kept.
        noise: (k,) or (n, k) 1-sigma of a reading, where it is known.
        regime: (n,) index into the names of regimes, as of phases of contact; None where there are none.
        channel: what was measured: `angle`, `torque`, `force`, ...; empty where an earlier version wrote it.
    """

    name: str
    unit: str
    time: np.ndarray
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray | None
    posture: np.ndarray | None = None
    noise: np.ndarray | None = None
    regime: np.ndarray | None = None
    channel: str = ""

    @property
    def left(self) -> np.ndarray:
        """Measured minus the last model's prediction, (n, k)."""
        return self.measured - (self.before if self.after is None else self.after)


def traces(items: Iterable[Item], predicted: Sequence[np.ndarray], regimes: Sequence[np.ndarray] = ()) -> list[Trace]:
    """Return the traces of items: for each, the principal columns, then the additional ones.

    Args:
        items: of an evidence.
        predicted: of each item (nworld, m, nch), by the given model and by the final one if there are two.
        regimes: of each item (m,).
    """
    out = []
    for r, (item, y) in enumerate(zip(items, predicted, strict=True)):
        start = 0
        for c in item.channels:
            columns = slice(start, start + c.measured.shape[1])
            worlds = [np.where(c.valid, world[:, columns], np.nan) for world in y]  # a plot shows the record's errors
            kept = start == 0 and c.unit != "rad" and item.posture.shape == c.measured.shape
            out.append(
                Trace(
                    name=item.name,
                    unit=c.unit,
                    time=item.segment.time,
                    measured=c.measured,
                    before=worlds[0],
                    after=worlds[1] if len(worlds) > 1 else None,
                    posture=item.posture if kept else None,
                    noise=np.broadcast_to(c.sigma, c.measured.shape if np.ndim(c.sigma) == 2 else c.measured.shape[1:]),
                    regime=regimes[r] if len(regimes) else None,
                    channel=c.kind,
                )
            )
            start = columns.stop
    return out


def arrays(drawn: Sequence[Trace], columns: Sequence[str], regimes: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """Return traces as arrays of evidence.npz: `R/KEY` of each stretch R, and the names of columns and regimes.

    A servo's load, which has no unit, is left out.
    """
    out: dict[str, np.ndarray] = {"joints": np.array(columns), "unit": np.array(drawn[0].unit)}
    out |= {"phases": np.array(regimes)} if len(regimes) else {}
    row, principal = -1, drawn[0].channel
    for trace in drawn:
        end = "" if trace.channel == principal else BESIDE.get(trace.channel)
        if end is None:
            continue
        values = {"measured": trace.measured, "before": trace.before, "after": trace.after}
        if not end:
            row += 1
            out |= {f"{row}/time": trace.time, f"{row}/name": np.array(trace.name)}
            values |= {"posture": trace.posture, "phase": trace.regime}
        values |= {"sigma": trace.noise, "channel": np.array(trace.channel)}
        out |= {f"{row}/{key}{end}": value for key, value in values.items() if value is not None}
    return out
