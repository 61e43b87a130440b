"""What the final model's missing torque depends on: a free curve over one input at a time, judged on held-out data.

An input is a quantity such as position, speed or time. Missing torque is defined in `localise`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vispeg.diagnosis.evidence.localise import MissingTorque
from vispeg.diagnosis.schema import Remainder

BINS = 24  # number of steps of a curve


@dataclass(frozen=True)
class Dependence:
    """Share of the held-out squared missing torque that a curve over `input` predicts in one joint: the best one."""

    input: str
    share: float
    joint: str


def dependences(
    fitted: list[MissingTorque], held_out: list[MissingTorque], joints: tuple[str, ...]
) -> list[Dependence]:
    """Rank inputs by the share of held-out missing torque that a curve of the fitted recordings predicts.

    The last input, frequency, is judged otherwise: by the strongest line in the held-out spectrum itself.
    """
    out = []
    for name, get in INPUTS.items():
        share, joint = 0.0, 0
        for j in range(len(joints)):
            x = np.concatenate([get(k, j) for k in fitted])
            y = np.concatenate([k.excess[:, j] for k in fitted])
            edges = np.unique(np.quantile(x, np.linspace(0, 1, BINS + 1)))
            if len(edges) < 4:
                continue
            cell = np.clip(np.digitize(x, edges) - 1, 0, len(edges) - 2)
            count = np.bincount(cell, minlength=len(edges) - 1)
            curve = np.bincount(cell, weights=y, minlength=len(edges) - 1) / np.maximum(count, 1)
            xv = np.concatenate([get(k, j) for k in held_out])
            yv = np.concatenate([k.excess[:, j] for k in held_out])
            predicted = curve[np.clip(np.digitize(xv, edges) - 1, 0, len(edges) - 2)]
            total = sum(float(np.sum((k.excess / k.sigma) ** 2)) for k in held_out)
            sigma = np.concatenate([np.full(len(k.time), k.sigma[j]) for k in held_out])
            gain = float(np.sum((yv**2 - (yv - predicted) ** 2) / sigma**2)) / max(total, 1e-12)
            if gain > share:
                share, joint = gain, j
        out.append(Dependence(name, round(share, 3), joints[joint]))
    share, frequency, joint = _tone(held_out)
    out.append(Dependence(f"frequency ({frequency:.1f} Hz)", round(share, 3), joints[joint]))
    return sorted(out, key=lambda d: -d.share)


INPUTS = {
    "position": lambda k, j: k.q[:, j],
    "speed": lambda k, j: k.dq[:, j],
    "load": lambda k, j: k.tau[:, j],
    "time": lambda k, j: k.time,
    "time x direction": lambda k, j: np.sign(k.dq[:, j]) * k.time,
}


def sizes(held_out: list[MissingTorque], joints: tuple[str, ...]) -> list[Remainder]:
    """Return for each joint the RMS of the torque still missing, minus noise, and of the torque it needed, N m."""
    missing = np.mean([np.mean(k.excess**2, axis=0) - k.sigma**2 for k in held_out], axis=0)
    needed = np.mean([np.mean(k.needed**2, axis=0) for k in held_out], axis=0)
    rms = np.sqrt(np.maximum(missing, 0.0)), np.sqrt(needed)
    return [
        {"joint": j, "rms": float(m), "needed": float(n), "unit": "N m"} for j, m, n in zip(joints, *rms, strict=True)
    ]


def _tone(missing: list[MissingTorque]) -> tuple[float, float, int]:
    """Return the share of missing torque within 0.4 Hz of its strongest line above 0.4 Hz, that line in Hz, and the
    index of its joint; all from the first item.
    """
    best, k = (0.0, 0.0, 0), missing[0]
    total = float(np.sum((k.excess / k.sigma) ** 2))
    for j in range(k.q.shape[1]):
        y = (k.excess[:, j] - k.excess[:, j].mean()) / k.sigma[j]
        f = np.fft.rfftfreq(len(y), float(np.mean(np.diff(k.time))))
        power = 2 * np.abs(np.fft.rfft(y)) ** 2 / len(y)
        power[f < 0.4] = 0.0
        at = int(np.argmax(power))
        share = float(power[np.abs(f - f[at]) <= 0.4].sum()) / max(total, 1e-12)
        if share > best[0]:
            best = (share, float(f[at]), j)
    return best
