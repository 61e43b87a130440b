"""An arm that errs moves what its camera sees of the cell, not of the tool: those edges stay trusted."""

from __future__ import annotations

import numpy as np
import pytest

from vispeg.identify.pictures.posture import Postures
from vispeg.identify.pictures.robust import noise_of, trust

FRAMES, TOOL, CELL, JOINTS, NOISE = 12, 130, 90, 7, 0.05


@pytest.fixture
def edges():
    """Misplacements px of tool and cell, one edge in twenty another thing's; the postures; which are the cell's."""
    rng = np.random.default_rng(0)
    frame = np.repeat(np.arange(FRAMES), TOOL + CELL)
    cell = np.tile(np.arange(TOOL + CELL) >= TOOL, FRAMES)
    slopes = rng.normal(size=(len(frame), JOINTS)) * 250.0 * cell[:, None]  # px a rad
    posture = rng.normal(size=(FRAMES, JOINTS)) * 1.25e-3  # rad: 1 mm at 0.8 m
    away = np.sum(slopes * posture[frame], axis=1) + rng.normal(size=len(frame)) * NOISE
    wrong = rng.random(len(frame)) < 0.05
    away[wrong] += rng.choice([-1, 1], wrong.sum()) * rng.uniform(1.5, 3.0, wrong.sum())
    away[rng.random(len(frame)) < 0.1] = np.nan
    return away, Postures(frame, slopes), cell & ~wrong & np.isfinite(away)


def test_by_the_tool_s_noise_most_of_the_cell_would_be_thrown_out(edges):
    away, _, cell = edges
    assert np.mean(trust(away, noise_of(away))[cell] > 0.05) < 0.6


def test_with_the_postures_taken_out_the_cell_is_trusted(edges):
    away, postures, cell = edges
    rest = postures.taken_out(away)
    assert noise_of(rest) == pytest.approx(NOISE, rel=0.25)
    assert np.mean(trust(rest, noise_of(rest))[cell] > 0.05) > 0.95
    assert np.array_equal(np.isnan(rest), np.isnan(away))


def test_edges_that_no_posture_moves_are_left_as_they_are(edges):
    away, postures, _ = edges
    still = Postures(postures.frame, np.zeros_like(postures.slopes))
    assert np.array_equal(still.taken_out(away), away, equal_nan=True)
