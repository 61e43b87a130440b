"""Sensor noise of a recording: as stated, or estimated from changes too fast for an arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.cell import LEVER
from vispeg.recordings.checks.quality import quantization
from vispeg.recordings.recording import Recording

NOISE = {"q": 2e-5, "dq": 1e-3, "tau": 0.2, "ee": 1e-4, "ft": 0.1, "ft_torque": 0.005}  # 1 sigma, SI: a good arm's
SILENT_TAU = 1e-5  # noise as a share of the peak torque below which a signal cannot be an unfiltered sensor's


def highpass_sigma(values: np.ndarray) -> np.ndarray:
    """Estimate the 1-sigma white noise of each column of (n, nj) from fourth differences.

    Motion is smooth over five samples. The fourth difference of white noise has variance 70 sigma^2 (sum of squared
    binomials 1 4 6 4 1). The median absolute deviation makes the estimate robust to jumps and reversals. It is 0
    without five consecutive readings.
    """
    diff = np.diff(values, 4, axis=0)
    sigma, known = np.zeros(values.shape[1]), np.isfinite(diff).any(axis=0)
    if known.any():
        diff = diff[:, known]
        sigma[known] = np.nanmedian(np.abs(diff - np.nanmedian(diff, axis=0)), axis=0) / np.sqrt(70.0)
    return 1.4826 * sigma  # from median absolute to standard deviation


def noise_of(rec: Recording) -> dict[str, np.ndarray]:
    """Return the 1-sigma noise per joint (nj,) of `q` (rad) and `tau` (N m): the stated one, else an estimate.

    Repeats (`Recording.held`) are left out: their steps would count as noise.
    """
    out = {}
    for name, least in (("q", 1e-7), ("tau", 1e-3)):  # least noise, rad and N m
        values = getattr(rec, name)
        if values is None:
            continue
        if name in rec.noise:
            out[name] = np.full(values.shape[1], float(rec.noise[name]))
        else:
            values = values if rec.held is None else values[~rec.held]
            out[name] = _pooled(np.maximum(highpass_sigma(values), _rounding(values)), least)
    return out


def _pooled(sigma: np.ndarray, least: float) -> np.ndarray:
    """Replace the noise of joints that show none (at rest within one encoder step) by that of the other joints."""
    noisy = sigma > least
    usual = float(np.median(sigma[noisy])) if noisy.any() else least
    return np.where(noisy, sigma, usual)


def _rounding(values: np.ndarray) -> np.ndarray:
    """Return the 1-sigma rounding error (nj,) of a quantized signal (n, nj): step / sqrt(12); 0 without a step."""
    return np.array([(quantization(column) or 0.0) / np.sqrt(12.0) for column in values.T])


def noise_from_repeats(recs: Sequence[Recording], signal: str = "q") -> np.ndarray:
    """Estimate the 1-sigma noise of one reading, repeatability included, from recordings of one commanded motion.

    The variance across recordings at each row (unbiased, over k - 1) is averaged over rows. Deviations that all
    recordings share, such as those of an unmodelled effect, do not contribute.

    Args:
        recs: at least two recordings, aligned in time from their first row on; the longest are cut to the shortest.
        signal: `q`, `dq`, `tau`, ...

    Returns:
        (nj,) in the signal's unit.

    Raises:
        UserError: fewer than two recordings, other joints, other times, other commands, or no such signal.
    """
    if len(recs) < 2:
        raise UserError("noise from repeats needs two recordings of one motion", got=len(recs))
    rows = min(len(rec.time) for rec in recs)
    for rec in recs[1:]:
        if not same_motion(recs[0], rec):
            raise UserError(f"does not repeat the motion of {recs[0].path}", file=rec.path)
    values = []
    for rec in recs:
        value = getattr(rec, signal)
        if value is None:
            raise UserError("has no such signal", file=rec.path, key=signal)
        values.append(value[:rows])
    return np.sqrt(np.nanmean(np.var(np.stack(values), axis=0, ddof=1), axis=0))


def noisy(key: str, values: np.ndarray, noise: Mapping[str, float], rng: np.random.Generator) -> np.ndarray:
    """Add white noise with the 1-sigma that `noise` states for this signal to readings (n, k); unchanged if it states
    none.

    A load has the torques' noise; the orientation of `ee` is taken as exact, so that quaternions stay of unit length;
    the torques of `ft` have their own, `ft_torque`.
    """
    draw = float(noise.get("tau" if key == "load" else key, 0.0)) * rng.standard_normal(values.shape)
    if key == "ee":
        draw[:, 3:] = 0.0
    if key == "ft" and noise.get("ft", 0.0) > 0:
        draw[:, 3:] *= float(noise.get("ft_torque", LEVER * noise["ft"])) / float(noise["ft"])
    return values + draw


def same_motion(a: Recording, b: Recording) -> bool:
    """Test whether two recordings have the same robot, controller and commands at the same times (to half a sample)."""
    rows = min(len(a.time), len(b.time))
    if (a.robot, a.joints, a.control.mode) != (b.robot, b.joints, b.control.mode):
        return False
    if rows < 0.9 * max(len(a.time), len(b.time)):
        return False
    skew = (a.time[:rows] - a.time[0]) - (b.time[:rows] - b.time[0])
    if np.abs(skew).max() > 0.5 / a.rate_hz:
        return False
    commands = [(getattr(a, name), getattr(b, name)) for name in ("q_cmd", "tau_cmd", "ee_cmd")]
    pairs = [(x[:rows], y[:rows]) for x, y in commands if x is not None and y is not None]
    return bool(pairs) and all(np.allclose(x, y, rtol=0, atol=1e-6, equal_nan=True) for x, y in pairs)


def silent(sigma: float | None, peak: float | None) -> bool:
    """Test whether a torque signal shows less noise than any unfiltered sensor has."""
    return sigma is not None and peak is not None and sigma < SILENT_TAU * peak
