"""Held-out errors of the model with each subset of its added effects: the page lets a reader switch them on and off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from vispeg.core.lines import thinned, thinned_time
from vispeg.identify.channels import Item
from vispeg.identify.evidence import Evidence
from vispeg.worlds.world import World

EVERY = 4  # most effects of which all subsets are computed; of more, see `choices`
POINTS = 700  # points in a residual's picture


def choices(count: int) -> np.ndarray:
    """Return which of `count` effects are on in each choice, (m, count) bool: none first, all last.

    Of up to EVERY effects every subset is a choice; of more, the first k effects for each k, and all but one.
    """
    if count <= EVERY:
        rows = [row[::-1] for row in product((False, True), repeat=count)]
    else:
        ladder = np.tri(count + 1, count, -1, dtype=bool)
        rows = [*ladder[:-1], *~np.eye(count, dtype=bool), ladder[-1]]
    unique = list(dict.fromkeys(tuple(map(bool, row)) for row in rows))
    return np.array(unique, dtype=bool).reshape(len(unique), count)


def subsets(
    judged: Evidence, world: World, n_fixed: int, alternatives: Sequence[tuple[str, World]] = ()
) -> dict[str, np.ndarray]:
    """Return the arrays of `evidence.npz` under `choice/`. Nothing is refitted: effects keep their values in `world`.

    Args:
        judged: held-out evidence.
        world: the model; effects after the first `n_fixed` were added.
        alternatives: label and world of each rival that explains the held-out data as well.

    Returns:
        m choices of the k added effects, the alternatives last: `on` (m, k) bool, all False for an alternative;
        `effect` and `where` (k,); `rival` (m,), an alternative's label, else ""; held-out RMS errors `error` (m,) and
        `joints` (m, nj), in the evidence's unit; and for item number r `r/time` (p,) and `r/residual` (m, p, nj),
        measured minus predicted, NaN where not valid.
    """
    added = world.effects[n_fixed:]
    on = choices(len(added))
    worlds = [replace(world, effects=(*world.effects[:n_fixed], *_chosen(added, row))) for row in on]
    worlds += [rival for _, rival in alternatives]
    nothing = np.zeros((len(alternatives), len(added)), bool)
    labels = [""] * len(on) + [label for label, _ in alternatives]
    predicted = judged.simulated(worlds)
    out = {
        "on": np.concatenate([on, nothing]),
        "effect": np.array([e.effect for e in added], dtype=str),
        "where": np.array([e.where for e in added], dtype=str),
        "rival": np.array(labels, dtype=str),
        "error": np.array([judged.rms_error(_residual(judged, predicted, i)) for i in range(len(worlds))]),
        "joints": _joint_errors(judged, predicted),
    }
    for r, (item, y) in enumerate(zip(judged.items, predicted, strict=True)):
        out[f"{r}/time"], out[f"{r}/residual"] = _drawn(item, y)
    return {f"choice/{key}": value for key, value in out.items()}


def _residual(judged: Evidence, predicted: Sequence[np.ndarray], i: int) -> np.ndarray:
    """Return the whitened residual of world i, as in `Evidence.residuals`, from each item's predictions (m, n, nch)."""
    return np.concatenate([judged.whiten(item, y[i]).ravel() for item, y in zip(judged.items, predicted, strict=True)])


def _chosen(effects: Sequence, row: np.ndarray) -> list:
    return [e for e, is_on in zip(effects, row, strict=True) if is_on]


def _joint_errors(judged: Evidence, predicted: Sequence[np.ndarray]) -> np.ndarray:
    """Return the RMS error of the first channel over valid readings, (m, nj)."""
    total, count = 0.0, 0
    for item, y in zip(judged.items, predicted, strict=True):
        valid = item.valid[:, : item.nj]
        gap = np.where(valid, item.measured[:, : item.nj] - y[:, :, : item.nj], 0.0)
        total, count = total + np.sum(gap**2, axis=1), count + valid.sum(axis=0)
    return np.sqrt(total / np.maximum(count, 1))


def _drawn(item: Item, predicted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return time (p,) and residual (m, p, nj) of m models for a picture, thinned to at most POINTS samples."""
    valid = item.valid[:, : item.nj]
    residual = np.where(valid, item.measured[:, : item.nj] - predicted[:, :, : item.nj], np.nan)
    m, n, nj = residual.shape
    lines = thinned(residual.transpose(1, 0, 2).reshape(n, m * nj), POINTS)
    time = thinned_time(item.segment.time, POINTS)
    return time, lines.reshape(len(time), m, nj).transpose(1, 0, 2).astype(np.float32)
