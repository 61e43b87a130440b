"""Of a long recording the windows are used that show the most, and which they are is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made import recording

from vispeg.core.errors import UserError
from vispeg.recordings.cell import Outcome
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.recordings.frames.joints import joints_at
from vispeg.recordings.load import load
from vispeg.recordings.windows import LENGTH, choose, split
from vispeg.recordings.write import write


def day(seconds=300.0, rate=50.0, bursts=(61.0, 200.0), seed=0, **changes):
    """Two joints at rest but for slow drifts, and bursts of 4 s in which they move as fast as they ever do."""
    time = np.arange(round(seconds * rate)) / rate
    q = np.stack([0.1 * np.sin(0.05 * time), 0.1 * np.cos(0.04 * time)], 1)
    for k, start in enumerate(bursts):
        on = (time >= start) & (time < start + 4.0)
        u = (time[on] - start) / 4.0
        q[on, k % 2] += 0.5 * np.sin(2 * np.pi * 4 * u) * np.sin(np.pi * u) ** 2
    q += np.random.default_rng(seed).normal(scale=1e-5, size=q.shape)
    fields = {"time": time, "q": q, "q_cmd": q, "tau": 10 * np.cos(q), "dq": None, "tau_cmd": None}
    return recording(len(time), rate, **(fields | dict.fromkeys(("ee", "ee_cmd", "ft")) | changes))


def test_the_windows_hold_what_is_rare():
    rec = day()
    cut = choose(rec, 24.0)
    assert cut.chosen is not None and cut.chosen.of_s == pytest.approx(300, abs=0.1)
    assert 18 < cut.chosen.used_s < 25
    for start in (61.0, 200.0):  # the fastest moment of each burst is in a window
        assert any(w.start < start + 2.0 < w.stop for w in cut.chosen.windows), start
    assert min(cut.chosen.speed, cut.chosen.acceleration) > 0.95 and cut.chosen.reversals >= 14
    assert cut.chosen.reversals <= cut.chosen.reversals_of
    said = cut.chosen.said("rig")
    assert "of 300 s are used" in said and f"{cut.chosen.windows[0].start:.4g}" in said and "reversals" in said


def test_windows_are_the_recordings_own_rows():
    rec = day()
    cut = choose(rec, 24.0)
    assert cut.episode is not None and cut.chosen is not None
    for number, window in enumerate(cut.chosen.windows):
        own = cut.episode == number
        rows = np.flatnonzero((rec.time >= window.start) & (rec.time <= window.stop))
        for name in ("time", "q", "q_cmd", "tau"):
            assert np.array_equal(getattr(cut, name)[own], getattr(rec, name)[rows]), name
        assert len(rows) / 50 >= LENGTH - 0.1
    spans = [(w.start, w.stop) for w in cut.chosen.windows]
    assert all(a[1] < b[0] for a, b in zip(spans, spans[1:], strict=False))


def test_windows_that_touch_stay_apart():
    """Rows of a batch last as long as the longest: a window of 18 s would make rollouts of all the others as long."""
    rec = day(seconds=120.0, bursts=(41.0, 47.0, 53.0, 59.0))
    cut = choose(rec, 48.0)
    assert cut.episode is not None and cut.chosen is not None
    spans = [(w.start, w.stop) for w in cut.chosen.windows]
    assert any(b[0] - a[1] < 0.03 for a, b in zip(spans, spans[1:], strict=False))  # some touch
    assert np.ptp(np.bincount(cut.episode)) <= 1 and len(spans) == 8


@pytest.mark.parametrize("stated", [25.0, 500.0])
def test_the_times_count_whatever_rate_the_header_states(stated):
    assert choose(replace(day(), rate_hz=stated), 24.0).chosen == choose(day(), 24.0).chosen


def test_rows_that_a_logger_writes_in_bursts_hide_no_motion():
    rec = day()
    time = rec.time + np.tile([0.0, -0.019, -0.038, -0.057], len(rec.time) // 4)  # four rows at once, 1 ms apart
    cut = choose(replace(rec, time=time, rate_hz=1000.0), 24.0)  # that of the median step, as convert writes it
    assert cut.chosen is not None and 18 < cut.chosen.used_s < 25 and cut.chosen.speed > 0.95


def test_short_recordings_are_used_whole():
    rec = day(50.0, bursts=(10.0,))
    assert choose(rec) is rec and choose(rec, 0) is rec and choose(day(), 0).chosen is None
    assert choose(day(), 300.0).chosen is None


def test_no_window_crosses_a_gap_an_episode_or_missing_readings():
    rec = day()
    keep = (rec.time < 63.0) | (rec.time > 90.0)
    parts = {n: getattr(rec, n)[keep] for n in ("time", "q", "q_cmd", "tau")}
    cut = choose(replace(rec, **parts), 24.0)
    assert cut.chosen is not None and all(w.stop < 63.1 or w.start > 89.9 for w in cut.chosen.windows)
    episode = (rec.time >= 202.0).astype(int)
    cut = choose(replace(rec, time=rec.time - 202.0 * episode, episode=episode), 24.0)
    assert cut.chosen is not None and cut.episode is not None
    for number in np.unique(cut.episode):
        assert np.all(np.diff(cut.time[cut.episode == number]) > 0)
    lost = day()
    lost.q[(lost.time > 60) & (lost.time < 66)] = np.nan
    cut = choose(lost, 24.0)
    assert np.isfinite(cut.q).mean() > 0.9
    every = day(bursts=())
    every = replace(every, time=np.arange(len(every.time)) * 1.0 + np.arange(len(every.time)) // 3 * 100.0)
    assert choose(every, 24.0).chosen is not None  # gaps everywhere: something is used, nothing breaks


def test_a_recording_is_cut_in_a_part_to_fit_and_a_part_to_judge_on():
    """Every row is on one side; whole episodes are held out where there are several; what cannot be cut is refused."""
    rec = day(20.0)
    first, last = split(rec, 0.3)
    assert len(first.time) + len(last.time) == len(rec.time) and first.time[-1] < last.time[0]
    assert last.time[-1] - last.time[0] == pytest.approx(0.3 * (rec.time[-1] - rec.time[0]), abs=0.1)
    assert np.array_equal(np.concatenate([first.q, last.q]), rec.q)
    several = replace(rec, episode=np.repeat(np.arange(4), -(-len(rec.time) // 4))[: len(rec.time)])
    first, last = split(several, 0.3)
    assert set(first.episode) == {0, 1, 2} and set(last.episode) == {3}
    for share in (0.0, 1.0, -1.0):
        with pytest.raises(UserError, match="hold_out"):
            split(rec, share)


def test_no_joint_stands_in_every_window_if_it_moves_somewhere():
    """One joint has two rich bursts, the other makes one short move between them: of two windows one is for each. Where
    there is room for one alone, what stands in it is named."""
    time = np.arange(round(300 * 50)) / 50
    u = np.clip((time - 150.0) / 0.15, 0.0, 1.0)
    once = 0.02 * (10 * u**3 - 15 * u**4 + 6 * u**5)
    q = np.stack([day(bursts=(61.0, 100.0, 200.0)).q[:, 0], once], 1)
    rec = day(q=q, q_cmd=q)
    cut = choose(rec, 12.0)
    assert cut.chosen is not None and not cut.chosen.standing and cut.chosen.speed > 0.9
    assert any(w.start < 150.1 < w.stop for w in cut.chosen.windows) and "moves in none" not in cut.chosen.said("rig")
    alone = choose(rec, 6.0)
    assert alone.chosen is not None and len(alone.chosen.standing) == 1
    assert f"{alone.chosen.standing[0]} moves in none of them: use more (--seconds)" in alone.chosen.said("rig")


def episodes_of(length: float, count: int, rate: float = 50.0, **changes):
    """Episodes of `length` s, each with its own clock from 0 and its own posture and speed."""
    n = round(length * rate)
    time, k = np.tile(np.arange(n) / rate, count), np.repeat(np.arange(count), n)
    q = np.stack([0.02 * k + 0.3 * np.sin(time * (1 + 0.05 * k)), 0.2 * np.cos(time)], 1)
    fields = {"time": time, "q": q, "q_cmd": q, "tau": 10 * np.cos(q), "dq": None, "tau_cmd": None, "episode": k}
    return recording(len(time), rate, **(fields | dict.fromkeys(("ee", "ee_cmd", "ft")) | changes))


def test_episodes_shorter_than_a_window_are_used_whole(tmp_path):
    """40 episodes of 5 s, as LeRobot's sets have them: of a minute, twelve are used, each from its begin to its end."""
    rec = episodes_of(5.0, 40)
    cut = choose(rec, 60.0)
    assert cut.chosen is not None and 45 < cut.chosen.used_s <= 60 and len(cut.chosen.windows) == 12
    for number in np.unique(cut.episode):
        own = cut.episode == number
        assert np.allclose(cut.time[own], np.arange(250) / 50) and np.ptp(cut.q[own, 1]) > 0.1
        assert any(np.array_equal(cut.q[own], rec.q[rec.episode == old]) for old in range(40))
    assert np.array_equal(load(write(cut, tmp_path / "cut")).q, cut.q)


def test_short_episodes_compete_with_windows_of_long_ones():
    """One of twenty short episodes holds the fastest motion, beside a long one that hardly moves: it is chosen."""
    rec = episodes_of(5.0, 20)
    long = np.arange(round(120 * 50)) / 50
    slow = np.stack([0.1 * np.sin(0.1 * long), 0.2 * np.cos(0.1 * long)], 1)
    q = np.concatenate([rec.q, slow])
    fast = rec.episode == 7
    q[: len(rec.q)][fast, 0] += 0.3 * np.sin(9 * rec.time[fast])
    episode = np.concatenate([rec.episode, np.full(len(long), 20)])
    rec = replace(rec, time=np.concatenate([rec.time, long]), q=q, q_cmd=q, tau=10 * np.cos(q), episode=episode)
    cut = choose(rec, 24.0)
    assert cut.chosen is not None and 18 < cut.chosen.used_s <= 24 and cut.chosen.speed > 0.95
    assert any(np.array_equal(cut.q[cut.episode == k], rec.q[episode == 7]) for k in np.unique(cut.episode))


def test_pictures_and_outcomes_stay_with_their_episode():
    """Of pictures that show the posture in one pixel, those within the chosen spans remain, and fit the new episode."""
    eye = RecordedCamera("eye", 1, 1, 1.0, 1.0, 0.0, 0.0)
    rec = episodes_of(5.0, 40)
    shots = [(k, t) for k in range(40) for t in (0.0, 2.0, 4.0)]
    seen = joints_at(rec, np.array([t for _, t in shots]), np.array([k for k, _ in shots]))
    taken_at = [
        RecordedFrame(t, eye, None, np.array([[angle]], np.float32), k)
        for (k, t), angle in zip(shots, seen[:, 0], strict=True)
    ]
    outcomes = tuple(Outcome(k % 3 == 0, k, f"trial {k}") for k in range(40))
    cut = choose(replace(rec, frames=Frames({"eye": eye}, tuple(taken_at)), outcomes=outcomes), 60.0)
    assert cut.frames is not None and len(cut.frames) == 36 and len(cut.outcomes) == 12
    shown = np.array([frame.depth[0, 0] for frame in cut.frames])
    assert joints_at(cut, cut.frames.times, cut.frames.episodes)[:, 0] == pytest.approx(shown, abs=1e-6)
    for outcome in cut.outcomes:
        old = int(outcome.category.split()[1])
        assert np.array_equal(cut.q[cut.episode == outcome.episode], rec.q[rec.episode == old])
    rec = day()
    frames = Frames(
        {"eye": eye}, tuple(RecordedFrame(t, eye, None, np.ones((1, 1), np.float32)) for t in rec.time[::5])
    )
    cut = choose(replace(rec, frames=frames, outcomes=(Outcome(True),)), 24.0)
    assert cut.chosen is not None and cut.frames is not None and not cut.outcomes  # a window is no whole trial
    for number, window in enumerate(cut.chosen.windows):
        times = cut.frames.times[cut.frames.episodes == number]
        assert window.start <= times[0] < window.start + 0.1 and window.stop - 0.1 < times[-1] <= window.stop
