"""Choose the stretches of a long recording that are worth simulating: those with the most varied motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.cell import Outcome
from vispeg.recordings.differentiate import episodes, smooth, usual_rate
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.recordings.recording import Chosen, Recording, Window

SECONDS = 60.0  # s of a recording that are used by default
LENGTH = 6.0  # s, length of a window: in a longer one errors of the start state matter less; shorter ones give a choice
LOOK_HZ, MOTION_HZ = 100.0, 10.0  # sample rate and bandwidth at which the motion is examined
STANDS = 0.02  # share of the top speed below which a joint counts as standing
SPEEDS, ACCELERATIONS, LOADS = 8, 6, 6  # bins per joint
ENOUGH = 0.1  # s in a cell beyond which further time has diminishing value
TOP = 0.999  # quantile used as the maximum, so that a single bad reading does not define it
READABLE = 0.9  # least share of a window's angles that must not be missing


def records(recordings: Sequence[Recording]) -> list[Mapping[str, object]]:
    """Return the chosen windows as plain data; empty if every recording is used whole."""
    return [{"recording": r.name} | asdict(r.chosen) | {"said": r.chosen.said(r.name)} for r in recordings if r.chosen]


def choose(rec: Recording, seconds: float = SECONDS) -> Recording:
    """Reduce a recording to at most `seconds`: itself if it is short, else its windows with the most varied motion.

    For each window and joint, the time in cells (bins) of signed speed, acceleration and load while moving is counted,
    and the number of reversals. Windows are chosen greedily to increase the sum over cells of log(1 + t / 0.1 s), with
    t the time in a cell, so that rare motion counts more than motion already covered. Windows in which a joint moves
    that would otherwise stand in all of them are chosen first. An episode shorter than a window is one as a whole.

    Args:
        rec: the recording.
        seconds: longest total duration, s, though one window is always used; 0 uses all.

    Returns:
        The recording with its windows as episodes, with unchanged times, and `chosen` set; `rec` where it is short.
    """
    runs = episodes(rec.time, rec.episode)
    length = float(sum(rec.time[rows[-1]] - rec.time[rows[0]] for rows in runs))
    if not 0 < seconds < length - LENGTH:
        return rec
    cells, turns, spans, tops = _cells(rec, runs)
    durations = np.array([rec.time[stop - 1] - rec.time[first] for first, stop in spans])
    moves = tops[0] > STANDS * tops[0].max(axis=0)  # (w, nj)
    picked = _greedy(cells, spans, durations, seconds)
    if not moves[picked].any(axis=0).all():
        picked = _greedy(cells, spans, durations, seconds, moves)
    picked = sorted(picked, key=lambda k: spans[k][0])
    parts = [spans[k] for k in picked]  # adjacent ones are not merged: a batch of equal lengths is simulated fastest
    most, overall = tops[:, picked].max(axis=1), tops.max(axis=1)
    cover = np.min(np.where(overall > 0, most / np.maximum(overall, 1e-12), 1.0), axis=-1)
    clock = rec.elapsed
    windows = tuple(Window(float(clock[first]), float(clock[stop - 1])) for first, stop in parts)
    chosen = Chosen(
        of_s=length,
        used_s=float(sum(w.stop - w.start for w in windows)),
        windows=windows,
        reversals=int(turns[picked].sum()),
        reversals_of=_all_turns(turns, spans),
        speed=float(cover[0]),
        acceleration=float(cover[1]),
        load=float(cover[2]),
        standing=tuple(j for j, there in zip(rec.joints, moves[picked].any(axis=0), strict=True) if not there),
    )
    return replace(taken(rec, parts), chosen=chosen)


def split(rec: Recording, share: float) -> tuple[Recording, Recording]:
    """Split a recording into a part to fit and a held-out end.

    Args:
        rec: the recording; with several episodes whole episodes are held out, else the last stretch of time.
        share: share of the time or of the episodes that is held out, between 0 and 1; at least one episode.

    Raises:
        UserError: a share that leaves one part empty, or a recording with pictures.
    """
    if rec.frames is not None:
        raise UserError("pictures are not cut", file=rec.path, key="--hold-out", expected="another recording to judge")
    if rec.episode is not None and len(np.unique(rec.episode)) > 1:
        numbers = np.unique(rec.episode)
        last = numbers[len(numbers) - min(max(1, round(share * len(numbers))), len(numbers) - 1) :]
        late = np.isin(rec.episode, last)
    else:
        late = rec.time >= rec.time[0] + (1 - share) * (rec.time[-1] - rec.time[0])
    if not 0 < share < 1 or late.all() or not late.any():
        raise UserError("leaves nothing to fit or to judge on", key="--hold-out", expected="0.2 to 0.5", got=share)
    parts = []
    for rows, name in ((~late, "first part"), (late, "last part")):
        parts.append(replace(rec.some(rows), path=rec.path.with_name(f"{rec.path.name}, {name}")))
    return parts[0], parts[1]


def taken(rec: Recording, parts: Sequence[tuple[int, int]]) -> Recording:
    """Cut the spans of rows (first, stop) from a recording; each becomes an episode; times stay.

    A span keeps the pictures taken during it, and an outcome if it is a whole episode.
    """
    rows = np.concatenate([np.arange(first, stop) for first, stop in parts])
    number = np.repeat(np.arange(len(parts)), [stop - first for first, stop in parts])
    old = np.zeros(len(rec.time), np.int64) if rec.episode is None else rec.episode
    frames: list[RecordedFrame] = []
    outcomes: list[Outcome] = []
    for new, (first, stop) in enumerate(parts):
        start, end = rec.time[first], rec.time[stop - 1]
        inside = (f for f in rec.frames or () if f.episode == old[first] and start <= f.time <= end)
        frames += [replace(frame, episode=new) for frame in inside]
        if np.sum(old == old[first]) == stop - first:
            outcomes += [replace(o, episode=new) for o in rec.outcomes if o.episode == old[first]]
    pictures = Frames(rec.frames.cameras, tuple(frames)) if rec.frames and frames else None
    return replace(rec.some(rows), episode=number, frames=pictures, outcomes=tuple(outcomes))


def _cells(
    rec: Recording, runs: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, list[tuple[int, int]], np.ndarray]:
    """Return for each of w windows what `choose` compares.

    Returns:
        Time in each of k cells, s, (w, k); number of reversals (w,); rows (first, stop) of each; peak speed, rad/s,
        acceleration, rad/s^2, and load, N m, (3, w, nj). Without recorded torque the load is the angle, rad.
    """
    rate = usual_rate(rec.time, runs, LENGTH)
    every = max(1, round(rate / LOOK_HZ))
    rows = np.concatenate([run[::every] for run in runs])
    episode = np.concatenate([np.full(len(run[::every]), k) for k, run in enumerate(runs)])
    motion = smooth(rec.time[rows], rec.q[rows], MOTION_HZ, episode)
    effort = rec.tau if rec.tau is not None else rec.tau_cmd
    load = motion[0] if effort is None else np.nan_to_num(effort[rows])
    dq, ddq = motion[1], motion[2]
    moving = np.abs(dq) > STANDS * _top(dq)
    parts = [
        _binned(dq, -_top(dq), _top(dq), SPEEDS, moving),
        _binned(ddq, -_top(ddq), _top(ddq), ACCELERATIONS, moving),
    ]
    low, high = np.nanquantile(load, 1 - TOP, axis=0), np.nanquantile(load, TOP, axis=0)
    parts.append(_binned(load, low, high, LOADS, moving))
    turn = _turns(dq, moving)
    parts.append(turn * np.uint8(LOOK_HZ / 4))  # a reversal counts as a quarter of a second in a cell of its own
    cell, period = np.concatenate(parts, axis=1), every / rate
    magnitudes = [np.minimum(np.nan_to_num(np.abs(x)), _top(x)) for x in (dq, ddq, load - (low + high) / 2)]
    width = max(1, round(LENGTH / period))
    counts, turns, spans, tops = [], [], [], []
    for part, (first, stop) in _candidates(runs, every, width):
        steps = (stop - 1 - first) / rate  # s, if no row is missing
        if not 0.8 * steps < rec.time[stop - 1] - rec.time[first] < 1.2 * steps:
            continue
        if np.mean(np.isfinite(dq[part])) < READABLE:
            continue
        counts.append(period * cell[part].sum(axis=0, dtype=float))
        turns.append(int(turn[part].sum()))
        spans.append((first, stop))
        tops.append([x[part].max(axis=0) for x in magnitudes])
    if not spans:  # gaps leave no whole window: the beginning is used
        spans = [(0, min(len(runs[0]), width * every))]
        counts, turns, tops = [np.zeros(cell.shape[1])], [0], [[x.max(axis=0) for x in magnitudes]]
    return np.array(counts), np.array(turns), spans, np.swapaxes(np.array(tops), 0, 1)


def _candidates(runs: Sequence[np.ndarray], every: int, width: int) -> Iterator[tuple[slice, tuple[int, int]]]:
    """Yield the windows of all episodes: overlapping ones of equal length, and short episodes as wholes.

    Args:
        runs: the row numbers of each episode.
        every: distance of examined rows, in rows of an episode.
        width: examined rows of a window.

    Yields:
        Slice of the examined rows of all episodes, and rows (first, stop) of the recording.
    """
    begin = 0
    for run in runs:
        examined = run[::every]
        if len(examined) <= width:
            yield slice(begin, begin + len(examined)), (int(run[0]), int(run[-1]) + 1)
        for start in range(0, len(examined) - width, max(1, width // 2)):
            at = begin + start
            yield slice(at, at + width), (int(examined[start]), int(examined[start + width]))
        begin += len(examined)


def _top(values: np.ndarray) -> np.ndarray:
    """Return the magnitude (nj,) that all but one in a thousand values stay below."""
    return np.maximum(np.nanquantile(np.abs(values), TOP, axis=0), 1e-9)


def _binned(values: np.ndarray, low: np.ndarray, high: np.ndarray, bins: int, counts: np.ndarray) -> np.ndarray:
    """Return (n, nj * bins) with 1 in the bin of each joint's value, where `counts` is True, else 0."""
    share = (np.nan_to_num(values) - low) / np.maximum(high - low, 1e-12)
    which = np.clip((share * bins).astype(int), 0, bins - 1)
    hit = (which[..., None] == np.arange(bins)) & (counts & np.isfinite(values))[..., None]
    return hit.reshape(len(values), -1).astype(np.uint8)


def _turns(dq: np.ndarray, moving: np.ndarray) -> np.ndarray:
    """Return (n, nj) with 1 where a joint begins to move opposite to its last motion, else 0."""
    out = np.zeros(dq.shape, np.uint8)
    for j in range(dq.shape[1]):
        rows = np.flatnonzero(moving[:, j])
        out[rows[1:], j] = np.diff(np.sign(dq[rows, j])) != 0
    return out


def _greedy(
    cells: np.ndarray,
    spans: list[tuple[int, int]],
    durations: np.ndarray,
    seconds: float,
    moves: np.ndarray | None = None,
) -> list[int]:
    """Choose windows (rows of `cells` (w, k)) greedily without overlap, each the one that adds most to the sum of logs.

    The windows last `durations` (w,) s, those chosen `seconds` in total at most. With `moves` (w, nj), windows with the
    most joints that stand in all windows chosen before come first.
    """
    have, free, picked = np.zeros(cells.shape[1]), np.ones(len(cells), bool), []
    moved = np.zeros(0 if moves is None else moves.shape[1], bool)
    starts, stops = np.array(spans).T
    left = max(seconds, durations.min())
    while (fits := free & (durations <= left)).any():
        gain = np.log1p((have + cells) / ENOUGH).sum(axis=1)
        if moves is not None:
            gain += (1.0 + gain.max()) * (moves & ~moved).sum(axis=1)  # more than the gain of any window
        best = int(np.argmax(np.where(fits, gain, -1.0)))
        if moves is not None:
            moved |= moves[best]
        picked.append(best)
        have += cells[best]
        left -= durations[best]
        free &= (stops <= starts[best]) | (starts >= stops[best])
    return picked


def _all_turns(turns: np.ndarray, spans: list[tuple[int, int]]) -> int:
    """Count the reversals of the whole recording: windows overlap by half, so every other window covers it once."""
    total, end = 0, -1
    for count, (first, stop) in zip(turns, spans, strict=True):
        if first >= end:
            total, end = total + int(count), stop
    return total
