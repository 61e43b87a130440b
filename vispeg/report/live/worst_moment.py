"""When a model is worst, recording by recording, and the arm in 3D that opens at that moment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from vispeg.report.evidence import Trace
from vispeg.report.live.arm import stage
from vispeg.report.live.traces import inert
from vispeg.report.text.quantities import quantity

SHOWN, LARGEST = 0.3, 500  # rad that the greatest error turns a joint by on the page; times at most


@dataclass(frozen=True)
class Worst:
    """The time, s, at which a model is farthest off over all joints together (`size`), and the joint that is."""

    time: float
    words: str
    size: float


def moment(trace: Trace, joints: Sequence[str]) -> Worst:
    """When the given model is worst in a recording."""
    off = np.nan_to_num(np.abs(trace.measured - trace.before), posinf=0.0)
    k = int(np.argmax(np.linalg.norm(off, axis=1)))
    j = int(np.argmax(off[k]))
    size = quantity(float(off[k, j]), trace.unit)
    words = f"{trace.name} at {trace.time[k]:.2f} s, where {joints[j]} is off by {size}"
    return Worst(round(float(trace.time[k]), 4), words, float(np.linalg.norm(off[k])))


def arm_stage(
    arm: Mapping[str, np.ndarray], traces: Sequence[Trace], joints: Sequence[str]
) -> dict[str, object] | None:
    """Give what the template `stage.html.j2` shows beside these tracks; None without an arm."""
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
