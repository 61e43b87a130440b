"""What the final model's missing torque depends on: a free curve over one input at a time, judged on held-out data.

An input is a quantity such as position, speed or time. Missing torque is defined in `localise`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vispeg.diagnosis.evidence.localise import MissingTorque
from vispeg.diagnosis.schema import Remainder

BINS = 24  # number of steps of a curve
FEWEST = 3  # least number of steps; an input with fewer hardly varies
LINE = 0.4  # Hz: half-width of a line in a spectrum, and the least frequency of one
INPUTS: dict[str, Callable[[MissingTorque, int], np.ndarray]] = {  # name -> values (m,) of an item in a joint
    "position": lambda item, j: item.q[:, j],
    "speed": lambda item, j: item.dq[:, j],
    "load": lambda item, j: item.tau[:, j],
    "time": lambda item, j: item.time,
    "time x direction": lambda item, j: np.sign(item.dq[:, j]) * item.time,
}


@dataclass(frozen=True)
class Dependence:
    """How much of the missing torque depends on an input.

    Attributes:
        input: the input.
        share: share of the held-out squared missing torque of all joints that a curve over the input predicts in one.
        joint: the joint with the largest share.
    """

    input: str
    share: float
    joint: str


def dependences(
    fitted: list[MissingTorque], held_out: list[MissingTorque], joints: tuple[str, ...]
) -> list[Dependence]:
    """Rank inputs by the share of held-out missing torque that a curve of the fitted recordings predicts.

    The last input, frequency, is judged otherwise: by the strongest line in the held-out spectrum itself.
    """
    total = sum(float(np.sum((item.excess / item.sigma) ** 2)) for item in held_out)
    out = []
    for name, get in INPUTS.items():
        share, joint = 0.0, 0
        for j in range(len(joints)):
            gain = _drop(get, j, fitted, held_out) / max(total, 1e-12)
            if gain > share:
                share, joint = gain, j
        out.append(Dependence(name, round(share, 3), joints[joint]))
    share, frequency, joint = _tone(held_out)
    out.append(Dependence(f"frequency ({frequency:.1f} Hz)", round(share, 3), joints[joint]))
    return sorted(out, key=lambda d: -d.share)


def _drop(
    get: Callable[[MissingTorque, int], np.ndarray], j: int, fitted: list[MissingTorque], held_out: list[MissingTorque]
) -> float:
    """Return the drop of the held-out squared missing torque, over noise, of joint `j` by a curve over an input.

    The curve is the mean of the fitted missing torque in each of up to `BINS` steps with as many samples; 0 if the
    input hardly varies.
    """

    def joined(items: list[MissingTorque]) -> tuple[np.ndarray, np.ndarray]:
        return np.concatenate([get(k, j) for k in items]), np.concatenate([k.excess[:, j] for k in items])

    x, y = joined(fitted)
    edges = np.unique(np.quantile(x, np.linspace(0, 1, BINS + 1)))
    count = len(edges) - 1
    if count < FEWEST:
        return 0.0
    step = np.clip(np.digitize(x, edges) - 1, 0, count - 1)
    samples = np.bincount(step, minlength=count)
    curve = np.bincount(step, weights=y, minlength=count) / np.maximum(samples, 1)
    x, y = joined(held_out)
    predicted = curve[np.clip(np.digitize(x, edges) - 1, 0, count - 1)]
    sigma = np.concatenate([np.full(len(item.time), item.sigma[j]) for item in held_out])
    return float(np.sum((y**2 - (y - predicted) ** 2) / sigma**2))


def sizes(held_out: list[MissingTorque], joints: tuple[str, ...]) -> list[Remainder]:
    """Return for each joint the RMS of the torque still missing, minus noise, and of the torque it needed, N m.

    Items count alike, however long they are.
    """
    missing = np.mean([np.mean(k.excess**2, axis=0) - k.sigma**2 for k in held_out], axis=0)
    needed = np.mean([np.mean(k.needed**2, axis=0) for k in held_out], axis=0)
    rms = np.sqrt(np.maximum(missing, 0.0)), np.sqrt(needed)
    return [
        {"joint": j, "rms": float(m), "needed": float(n), "unit": "N m"} for j, m, n in zip(joints, *rms, strict=True)
    ]


def _tone(missing: list[MissingTorque]) -> tuple[float, float, int]:
    """Return the share of the first item's missing torque in its strongest line, that line's Hz and its joint's index.

    A line is all within `LINE` of its frequency.
    """
    best, item = (0.0, 0.0, 0), missing[0]
    total = float(np.sum((item.excess / item.sigma) ** 2))
    for j in range(item.q.shape[1]):
        y = (item.excess[:, j] - item.excess[:, j].mean()) / item.sigma[j]
        f = np.fft.rfftfreq(len(y), float(np.mean(np.diff(item.time))))
        power = 2 * np.abs(np.fft.rfft(y)) ** 2 / len(y)  # its sum is that of y^2
        power[f < LINE] = 0.0
        at = int(np.argmax(power))
        share = float(power[np.abs(f - f[at]) <= LINE].sum()) / max(total, 1e-12)
        if share > best[0]:
            best = (share, float(f[at]), j)
    return best
