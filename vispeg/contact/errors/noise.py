"""Noise of the wrench at rest, compared with the stated noise: an excess is an effect of the sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vispeg.contact.inputs import ContactItem
from vispeg.core.effect import EffectInstance
from vispeg.core.params import Value
from vispeg.core.rules import RULES
from vispeg.recordings.cell import WrenchSensor, wrench_noise
from vispeg.recordings.noise import highpass_sigma
from vispeg.worlds.world import World

# Standard deviation of a robust estimate from fourth differences, over that from the readings, by simulation. Of
# independent values the median absolute deviation has 1.65, but each reading is in five differences.
SPREAD = 2.26
PARTS = {"force": slice(0, 3), "torque": slice(3, 6)}


def noise_at_rest(item: ContactItem) -> tuple[np.ndarray, np.ndarray]:
    """Return the white noise of each channel (6,) while the hand rests, N and N m, and its standard error."""
    begin, end = item.path.time[item.phase.rest.start], item.path.time[item.phase.rest.stop - 1]
    rest = item.path.rows[(item.path.clock >= begin) & (item.path.clock < end)]
    level = highpass_sigma(item.source.wrench[rest])
    return level, SPREAD * level / np.sqrt(2 * len(rest))


def noise_of_blocks(item: ContactItem) -> tuple[np.ndarray, np.ndarray]:
    """Return the noise of block means at rest, (6,) N and N m, as that of independent samples, and its standard error.

    It exceeds `noise_at_rest` if the noise of neighbouring samples is alike, as where a slower sensor's readings were
    interpolated. It is taken from the steps between neighbouring blocks (von Neumann's estimate), free of drift.
    """
    means = item.phase.means(item.path.wrench[None])[0, item.phase.resting]
    samples, m = item.period / np.median(np.diff(item.path.clock)), len(means)
    level = np.sqrt(0.5 * samples * np.mean(np.diff(means, axis=0) ** 2, axis=0))
    return level, level * np.sqrt(3 * m - 4) / (2 * (m - 1))  # of von Neumann's estimate from m independent means


def noise(item: ContactItem) -> np.ndarray:
    """Return the noise (6,) N, N m, as that of independent samples.

    It is as stated, or as measured if that is clearly larger or none is stated; or as block means show, if that is
    clearly larger still.
    """
    level, _ = noise_at_rest(item)
    if wrench_noise(item.recording.noise) is not None:
        stated = _stated(item)
        level = np.where(_excess([item])[0], np.maximum(level, stated), stated)
    slow, error = noise_of_blocks(item)
    return np.where(_louder(slow, error, level), np.maximum(slow, level), level)


def excess_noise(
    world: World, fitted: Sequence[ContactItem], held_out: Sequence[ContactItem]
) -> tuple[EffectInstance, ...]:
    """Return `wrench_noise` in excess of the stated noise, if fitted and held-out recordings both show it.

    It is empty if `world` has that effect.
    """
    items = [[i for i in group if wrench_noise(i.recording.noise) is not None] for group in (fitted, held_out)]
    if not all(items) or any(e.effect == "wrench_noise" for e in world.effects):
        return ()
    louder, level, error, stated = _excess(items[0])
    louder = louder & _excess(items[1])[0]
    params = {}
    for name, part in PARTS.items():
        if louder[part].any():
            middle, wide = level[part].mean(), 1.96 * error[part].mean() / np.sqrt(3)  # of the mean of three channels
            levels = np.maximum(np.array([middle, middle - wide, middle + wide]) ** 2 - stated[part].mean() ** 2, 0.0)
            params[name] = Value(*np.sqrt(levels).tolist())
    placed = EffectInstance.of("wrench_noise", "flange")
    return (replace(placed, params={**placed.params, **params}),) if params else ()


def _excess(items: Sequence[ContactItem]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return which channels have more noise than stated, (6,) bool, with measured noise, its error, stated noise."""
    values = [noise_at_rest(i) for i in items]
    level = np.sqrt(np.mean([s**2 for s, _ in values], axis=0))
    error = np.sqrt(np.sum([e**2 for _, e in values], axis=0)) / len(values)
    stated = np.sqrt(np.mean([np.square(_stated(i)) for i in items], axis=0))
    return _louder(level, error, stated), level, error, stated


def _louder(level: np.ndarray, error: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return which channels' noise (6,), of such standard errors, is larger than a known one, (6,) bool.

    The three force channels are decided together, and so are the three torque channels. The excess must be larger than
    rounding and chance explain.
    """
    louder = np.zeros(6, bool)
    for part in PARTS.values():
        low = level[part].mean() - RULES.noise_sigmas * error[part].mean() / np.sqrt(3)
        louder[part] = low > RULES.noise_louder * known[part].mean()
    return louder


def _stated(item: ContactItem) -> np.ndarray:
    """Return the noise (6,) N, N m about the flange's origin, as stated for the sensor; infinite if none is stated.

    A sensor at `pos` adds the moment of its forces' noise, which is alike in all axes.
    """
    stated = wrench_noise(item.recording.noise)
    if stated is None:
        return np.full(6, np.inf)
    pos = np.array((item.recording.wrench or WrenchSensor()).pos)
    stated[3:] = np.sqrt(stated[3:] ** 2 + (pos @ pos - pos**2) * stated[0] ** 2)
    return stated
