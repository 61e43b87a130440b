"""Repair a log's clock: repeated rows, backward steps, sparse commands."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.core.notes import note

COMMANDS = ("q_cmd", "dq_cmd")
LONGEST = 3.5  # times the usual interval between commands: after a longer silence the command counts as unknown
NAMED = 3  # backward steps that a note lists individually


def cleaned(
    columns: dict[str, np.ndarray], source: Path, numbers: range | np.ndarray
) -> tuple[dict[str, np.ndarray], range | np.ndarray]:
    """Drop repeated rows, start a new episode where the clock steps back, and hold sparse commands; note each repair.

    A row with the previous row's time but different values is an error: nothing says which of the two is right.

    Args:
        columns: `time` (n,) s, optionally `episode`, and signals.
        source: the file, named in notes and errors.
        numbers: number of each sample's row in the source, as `Table.numbers`.

    Returns:
        The columns and the numbers of the rows that are kept.

    Raises:
        UserError: two rows of one time with different values.
    """
    time = columns["time"]
    if len(time) < 2 or not np.isfinite(time).all():
        return columns, numbers
    episode = columns.get("episode", np.zeros(len(time)))
    same = (np.diff(time) == 0) & (np.diff(episode) == 0)
    if same.any():
        repeated = same.copy()
        for values in columns.values():
            repeated &= (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
        if (same & ~repeated).any():
            row = int(np.flatnonzero(same & ~repeated)[0]) + 1
            raise UserError(
                "two rows of one time with other values",
                file=source,
                key=f"row {numbers[row]}",
                expected="a time of its own for every reading",
                got=float(time[row]),
            )
        keep = np.concatenate([[True], ~repeated])
        note(f"{source}: {count(int(repeated.sum()), 'row')} left out: the same as the one before, with its time")
        columns = {name: values[keep] for name, values in columns.items()}
        numbers = np.asarray(numbers)[keep]
    return _held(_cut(columns, source, numbers), source), numbers


def counted(episode: np.ndarray | None, rows: int, rate_hz: float, source: Path, named: Collection[str]) -> np.ndarray:
    """Return each sample's time from the start of its episode at a stated rate, (rows,) s.

    A note says so if the source, of columns or arrays `named`, has a `time` of its own.
    """
    if "time" in named:
        note(f"{source}: its `time` is not used: {rate_hz:g} samples a second are stated")
    index = np.arange(rows, dtype=float)
    if episode is not None:
        starts = np.flatnonzero(np.diff(episode, prepend=np.nan) != 0)
        index -= np.repeat(starts, np.diff(np.append(starts, rows)))
    return index / rate_hz


def _cut(columns: dict[str, np.ndarray], source: Path, numbers: range | np.ndarray) -> dict[str, np.ndarray]:
    """Start a new episode wherever the clock steps back within one; what comes before keeps the file's number."""
    time = columns["time"]
    episode = columns.get("episode", np.zeros(len(time)))
    inside = np.diff(episode) == 0
    back = np.flatnonzero(inside & (np.diff(time) < 0))
    if not len(back):
        return columns
    steps_back, begins = np.zeros(len(time), bool), np.concatenate([[True], ~inside])
    steps_back[back + 1] = True
    begins |= steps_back
    first = np.maximum.accumulate(np.where(begins, np.arange(len(time)), 0))  # row at which the piece begins
    named = ", ".join(f"by {time[i] - time[i + 1]:.4g} s at row {numbers[i + 1]}" for i in back[:NAMED])
    more = f" and {len(back) - NAMED} times more" if len(back) > NAMED else ""
    note(f"{source}: the clock stepped back {named}{more}: an episode ends there, and the next begins")
    return columns | {"episode": np.where(steps_back[first], episode.max() + np.cumsum(steps_back), episode)}


def _held(columns: dict[str, np.ndarray], source: Path) -> dict[str, np.ndarray]:
    """Hold commands that come less often than readings until the next command."""
    time, out, held = columns["time"], dict(columns), 0
    episode = columns.get("episode", np.zeros(len(time)))
    for name, values in columns.items():
        read = np.isfinite(values)
        if name.partition(".")[0] not in COMMANDS or read.all() or read.sum() < 2:
            continue
        usual = np.median(np.diff(np.flatnonzero(read)))
        if usual < 2:
            continue  # commands come with nearly every reading: the rest are missing values, not holds
        last = np.maximum.accumulate(np.where(read, np.arange(len(values)), -1))
        known = (last >= 0) & (np.arange(len(values)) - last <= LONGEST * usual) & (episode[last] == episode)
        out[name] = np.where(known, values[np.maximum(last, 0)], np.nan)
        held += 1
    if held:
        note(f"{source}: commands come less often than readings: each holds until the next")
    return out
