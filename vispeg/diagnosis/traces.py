"""Measured values with model predictions over time: the one type behind reports, pages, evidence.npz and notebooks.

A trace is one kind of measured value in one stretch of a recording, with the predictions of up to two models.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.identify.channels import Item

BESIDE = {"torque": "_tau", "moment": "_tau"}  # channel that is compared beside the first one -> suffix of its keys


@dataclass(frozen=True)
class Trace:
    """One kind of measured value in one stretch of a recording; arrays (n, k) in `unit`, a column per joint or axis.

    Attributes:
        name: the recording's name, and where in it the stretch begins.
        unit: of the values.
        time: (n,) s; episodes are laid end to end.
        measured: measured values.
        before, after: predictions of the first and of the final model, NaN where nothing is compared; `after` is None
            if there is one model only.
        posture: (n, nj) measured angles, rad, if the trace itself is not of angles and they were kept; else None.
        noise: (k,) or (n, k) standard deviation of a reading; None if unknown.
        regime: (n,) index into a list of names, such as phases of contact; None if there is no such list.
        channel: what was measured: `angle`, `torque`, `force`, ...; empty in files of earlier versions.
        beside: whether another channel of the stretch is the principal one.
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
    beside: bool = False

    @property
    def left(self) -> np.ndarray:
        """Measured minus the last model's prediction, (n, k)."""
        return self.measured - (self.before if self.after is None else self.after)


def traces(items: Iterable[Item], predicted: Sequence[np.ndarray], regimes: Sequence[np.ndarray] = ()) -> list[Trace]:
    """Return the traces of items: one for each channel of each item, in the items' order.

    Args:
        items: of an evidence.
        predicted: for each item (nworld, m, nch), by the first model and, if there are two, by the final one.
        regimes: for each item (m,), the index of each sample's regime; empty if there are none.
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
                    beside=start > 0,
                )
            )
            start = columns.stop
    return out


def arrays(drawn: Sequence[Trace], columns: Sequence[str], regimes: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """Return traces as arrays of evidence.npz: `R/KEY` for stretch number R, and the names of columns and regimes.

    Keys of a stretch's second channel end in `_tau`. A channel that is neither principal nor in `BESIDE`, such as a
    servo's load, is left out.
    """
    out: dict[str, np.ndarray] = {"joints": np.array(columns), "unit": np.array(drawn[0].unit)}
    out |= {"phases": np.array(regimes)} if len(regimes) else {}
    row = -1
    for trace in drawn:
        suffix = BESIDE.get(trace.channel) if trace.beside else ""
        if suffix is None:
            continue
        values = {"measured": trace.measured, "before": trace.before, "after": trace.after}
        if not suffix:
            row += 1
            out |= {f"{row}/time": trace.time, f"{row}/name": np.array(trace.name)}
            values |= {"posture": trace.posture, "phase": trace.regime}
        values |= {"sigma": trace.noise, "channel": np.array(trace.channel)}
        out |= {f"{row}/{key}{suffix}": value for key, value in values.items() if value is not None}
    return out
