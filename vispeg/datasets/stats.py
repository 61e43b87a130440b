"""Statistics of features: minimum, maximum, mean, standard deviation and quantiles of an episode or of several.

Pictures have statistics for each channel, with values from 0 to 1 (depth: in m; part numbers unchanged). Statistics of
episodes are combined as in Chan, Golub and LeVeque, "Algorithms for computing the sample variance" (1983); combined
quantiles are means of the episodes' quantiles.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from vispeg.datasets.layout import Feature, is_depth, is_image

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
Stats = dict[str, list[Any]]


def of_numbers(values: np.ndarray) -> Stats:
    """Compute the statistics of (T, d) or (T,) numbers: lists of d entries; `count` has one entry."""
    v = np.asarray(values, float).reshape(len(values), -1)
    out = {"min": v.min(axis=0), "max": v.max(axis=0), "mean": v.mean(axis=0), "std": v.std(axis=0)}
    out |= dict(zip(QUANTILES, np.quantile(v, list(QUANTILES.values()), axis=0), strict=True))
    return {**{k: x.tolist() for k, x in out.items()}, "count": [len(v)]}


class PictureStats:
    """Accumulate statistics of a feature's pictures; quantiles come from histograms (depth: 1 mm bins up to 4 m)."""

    def __init__(self, feature: Feature):
        self.depth, self.channels = is_depth(feature), (*feature["shape"], 1)[2]  # (H, W) has one channel
        self.shape = (-1, 1, 1) if is_image(feature) else (1, 1)
        self.bins = 4001 if self.depth else 256
        self.step = 1e-3 if self.depth else 1 / 255 if is_image(feature) else 1.0
        self.histogram = np.zeros((self.channels, self.bins), np.int64)
        self.low, self.high = np.full(self.channels, np.inf), np.full(self.channels, -np.inf)
        self.sum, self.squares, self.pixels, self.frames = np.zeros(self.channels), np.zeros(self.channels), 0, 0

    def add(self, image: np.ndarray) -> None:
        """Add a picture, (H, W, 3) or (H, W)."""
        values = image.reshape(-1, self.channels)
        if self.depth:
            real = values.astype(float)
            index = np.minimum(np.round(real / self.step), self.bins - 1).astype(np.int64)
            self.low, self.high = np.minimum(self.low, real.min(axis=0)), np.maximum(self.high, real.max(axis=0))
            self.sum += real.sum(axis=0)
            self.squares += (real**2).sum(axis=0)
        else:
            index = values
        for c in range(self.channels):
            self.histogram[c] += np.bincount(index[:, c], minlength=self.bins)
        self.pixels += len(values)
        self.frames += 1

    def _moments(self) -> None:
        """Compute the moments of 8-bit images exactly, from their histogram."""
        level = np.arange(self.bins) * self.step
        filled = self.histogram > 0
        self.low, self.high = level[filled.argmax(axis=1)], level[self.bins - 1 - filled[:, ::-1].argmax(axis=1)]
        self.sum, self.squares = self.histogram @ level, self.histogram @ level**2

    def result(self) -> Stats:
        """Return entries of shape (channels, 1, 1), for array features (1, 1); `count` is the number of pictures."""
        if not self.depth:
            self._moments()
        mean = self.sum / self.pixels
        spread = np.sqrt(np.maximum(self.squares / self.pixels - mean**2, 0.0))
        out = {"min": self.low, "max": self.high, "mean": mean, "std": spread}
        share = np.cumsum(self.histogram, axis=1) / self.pixels
        for name, q in QUANTILES.items():
            out[name] = np.array([np.searchsorted(s, q) for s in share]) * self.step
        return {**{k: x.reshape(self.shape).tolist() for k, x in out.items()}, "count": [self.frames]}


def together(parts: Iterable[Mapping[str, Any]]) -> Stats:
    """Combine the statistics of several episodes."""
    entries = list(parts)
    n = np.array([p["count"][0] for p in entries], float)
    weights = n / n.sum()

    def every(key: str) -> np.ndarray:
        return np.array([p[key] for p in entries], float)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.tensordot(weights, values, axes=1)

    centre = mean(every("mean"))
    spread = np.sqrt(np.maximum(mean(every("std") ** 2 + (every("mean") - centre) ** 2), 0.0))
    out = {"min": every("min").min(axis=0), "max": every("max").max(axis=0), "mean": centre, "std": spread}
    out |= {q: mean(every(q)) for q in QUANTILES}
    return {**{k: x.tolist() for k, x in out.items()}, "count": [int(n.sum())]}
