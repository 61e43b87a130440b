"""Whitened residuals: unit variance at the truth, penalties for divergence, bookkeeping that adds up."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from loops import iiwa_segment, recorded

from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.identify.evidence import PENALTY, READINGS, Evidence
from vispeg.identify.inverse import evidence_for
from vispeg.robots.model import load
from vispeg.worlds.world import World

ROBOT = load("iiwa14")
TRUTH = World().add(EffectInstance.of("viscous_friction", "joint4", damping=2.0))


@pytest.fixture(scope="module")
def recordings():
    return [recorded(ROBOT, "iiwa14", TRUTH, iiwa_segment("position", 1.6, seed=s), stream(1, s)) for s in (0, 1)]


@pytest.fixture(scope="module")
def evidence(recordings):
    return Evidence(recordings)


def split(evidence, residual):
    """(item, residual (m, nch)) pairs of a flat residual."""
    start = 0
    for item in evidence.items:
        yield item, residual[start : start + item.measured.size].reshape(item.measured.shape)
        start += item.measured.size
    assert start == len(residual)


def test_truth_leaves_white_noise_of_unit_variance(evidence):
    for item, r in split(evidence, evidence.residuals([TRUTH])[0]):
        used = r[item.valid]
        assert np.mean(used**2) == pytest.approx(1.0, abs=0.1)
        assert abs(np.mean(used)) < 0.05
        late = r[item.segment.time > RULES.settle + 0.2]
        neighbours = np.mean(late[1:] * late[:-1]) / np.mean(late**2)
        assert abs(neighbours) < 0.05
        assert not r[~item.valid].any()


def test_a_wrong_world_is_worse_where_it_is_wrong(evidence):
    wrong, right = evidence.residuals([World(), TRUTH])
    for (_, bad), (_, good) in zip(split(evidence, wrong), split(evidence, right), strict=True):
        excess = np.mean(bad**2, axis=0)[:7] - np.mean(good**2, axis=0)[:7]
        assert np.argmax(excess) == 3 and excess[3] > 100


def test_errors_come_back_in_radians(evidence):
    """`rms_error` of the truth is the noise floor; of another world, the RMS of the angle differences."""
    right, wrong = evidence.residuals([TRUTH, World()])
    assert evidence.rms_error(right) == pytest.approx(evidence.floor, rel=0.05)
    assert evidence.floor == pytest.approx(2e-5, rel=0.05)
    predicted = evidence.simulated([World()])
    gaps = [
        (i.measured[:, :7] - y[0][:, :7])[i.segment.time >= RULES.settle]
        for i, y in zip(evidence.items, predicted, strict=True)
    ]
    assert evidence.rms_error(wrong) == pytest.approx(np.sqrt(np.mean(np.concatenate(gaps) ** 2)), rel=1e-9)


def test_answers_do_not_depend_on_company(evidence):
    others = [World().add(EffectInstance.of("viscous_friction", j, damping=1.0)) for j in ROBOT.joints]
    alone, among = evidence.residuals([TRUTH])[0], evidence.residuals([*others, TRUTH])[-1]
    np.testing.assert_array_equal(alone, among)


def test_divergence_is_a_finite_penalty(evidence):
    wild = World().add(EffectInstance.of("command_delay", "all", delay=0.03))
    r, fine = evidence.residuals([wild, TRUTH])
    assert np.isfinite(r).all() and np.abs(r).max() == PENALTY
    assert np.abs(fine).max() < 10


def test_missing_readings_count_nothing(recordings):
    q = recordings[0].q.copy()
    q[400:450, 2] = np.nan
    holed = Evidence([replace(recordings[0], q=q)])
    whole = Evidence([recordings[0]])
    assert whole.count - holed.count == 50
    (_, r), (_, full) = next(split(holed, holed.residuals([TRUTH])[0])), next(split(whole, whole.residuals([TRUTH])[0]))
    assert not r[400:450, 2].any()
    assert np.abs(np.delete(r, 2, axis=1) - np.delete(full, 2, axis=1)).max() < 0.2  # the start state alone may differ


def test_blocks_never_span_two_recordings(evidence):
    numbers = [set(np.unique(r)) for _, r in split(evidence, evidence.blocks())]
    assert not numbers[0] & numbers[1]
    assert numbers[0] | numbers[1] == set(range(len(numbers[0]) + len(numbers[1])))


def test_unusable_recordings_are_refused(recordings):
    short = replace(
        recordings[0], **{k: getattr(recordings[0], k)[:300] for k in ("time", "q", "tau", "q_cmd", "dq_cmd")}
    )
    with pytest.raises(UserError, match="too short"):
        Evidence([short])
    with pytest.raises(UserError, match="joints"):
        Evidence([replace(recordings[0], joints=tuple(f"a{i}" for i in range(7)))])
    with pytest.raises(UserError, match="different robots"):
        evidence_for([recordings[0], replace(recordings[1], robot="other.xml")])


@pytest.mark.slow
def test_worlds_are_rolled_out_a_few_at_a_time_where_memory_is_short(evidence, monkeypatch):
    worlds = [World().add(EffectInstance.of("viscous_friction", "joint4", damping=0.1 * k)) for k in range(1, 25)]
    size = sum(4 * 8 * i.segment.time.size * i.nj for i in evidence.items)
    answers, peaks = [], []
    for limit in (100 * size, 2.5 * size):
        monkeypatch.setattr("vispeg.identify.evidence.AT_ONCE", limit)
        tracemalloc.start()
        answers.append([float(r @ r) for r in evidence.each_residual(worlds)])
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    np.testing.assert_allclose(answers[1], answers[0], rtol=1e-9)
    assert peaks[1] < 0.4 * peaks[0]  # two of 24 at a time, beside what does not depend on their number


def test_readings_beyond_what_is_needed_are_left_out_evenly(recordings, evidence, monkeypatch):
    """What is compared of a long log is what the whole of it says at those samples, and the notes say it."""
    monkeypatch.setattr("vispeg.identify.evidence.READINGS", evidence.length / 2.5)
    part = Evidence(recordings)
    pairs = zip(
        split(part, part.residuals([World()])[0]), split(evidence, evidence.residuals([World()])[0]), strict=True
    )
    for (_, some), (_, every) in pairs:
        np.testing.assert_allclose(some, every[::3], rtol=1e-9, atol=1e-9)  # of noise; sums of another order
    assert len(part.notes) == len(evidence.notes) + 2 and all("one sample in 3" in note for note in part.notes[:2])


def test_of_a_long_log_no_more_is_held_than_of_a_short_one(recordings):
    """Two minutes of seven joints at 500 Hz: each residual, of which a search holds hundreds, is 1.2 MB."""
    rec, rows = recordings[0], 60_000
    time = np.arange(rows) / rec.rate_hz
    q = rec.q[0] + 0.3 * np.sin(0.5 * time[:, None] + np.arange(len(rec.joints)))
    long = {"time": time, "q": q, "q_cmd": q, "tau": np.zeros_like(q), "dq": None, "dq_cmd": None}
    tracemalloc.start()
    evidence = Evidence([replace(rec, **long)])
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert READINGS / 2 < evidence.length <= READINGS
    assert kept < 3 * (q.nbytes + long["tau"].nbytes)
