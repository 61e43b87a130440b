"""Propose user-defined signals: one column per joint, of a quantity for which a recording has no column."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.recordings.columns import SIGNALS
from vispeg.recordings.importers.guess import values
from vispeg.recordings.importers.guess.names import NO_JOINT, ampere, bare, meaning, split
from vispeg.recordings.importers.guess.propose import Line, Proposal
from vispeg.recordings.tables.table import Table

MEASURES = ("", "current", "temperature", "voltage")  # what is kept; the other quantities follow from known columns
APART = NO_JOINT | {  # words of columns that may be as many as the joints, but are not theirs
    "analog", "cartesian", "digital", "ee", "flange", "force", "forces", "ft", "pose", "quat", "register", "tool",
    "wrench",
}  # fmt: skip
BRACKETED = r"[\[(]\s*([^\])\d\s][^\])]*?)\s*[\])]"
WORDED = r"(?<![A-Za-z0-9])(mV|degC|[kM]?Hz|[kM]?Pa|bar)(?![A-Za-z0-9])"  # units that a name may state without brackets
UNKNOWN = "unknown"


@dataclass(frozen=True)
class _Column:
    """A column that may belong to a signal.

    Attributes:
        name: the column.
        stem: its name without unit and joint, words joined by `_`.
        quantity: of `MEASURES`, if it is measured and not commanded.
        unit: as the name states it, or empty.
        joint: a joint's name, the number in the column's name, or None if the name tells neither.
    """

    name: str
    stem: str
    quantity: str
    unit: str
    joint: str | int | None


def own_signals(out: Proposal, table: Table, joints: Sequence[str], labels: Mapping[str, str]) -> None:
    """Propose a user-defined signal for each group of unused columns with one column per joint.

    Args:
        out: the proposal, modified in place.
        table: the columns of the file.
        joints: the robot's.
        labels: column -> joint, where known from a source other than the header.
    """
    count = len(joints)
    angles = {line.column: line.target.partition(".")[2] for line in out.lines if line.target.startswith("q.")}
    taken = {line.column for line in out.lines} | {line.plus[0] for line in out.lines if line.plus is not None}
    called = {column: _split(column, "", joints, labels)[2] for column in angles}
    if any(isinstance(called[column], str) and called[column] != joint for column, joint in angles.items()):
        joints = ()  # the angles' names are numbers, `joint_0` for the first joint, whatever the joints are called
    groups: dict[str, list[_Column]] = {}
    for name in table.columns:
        m = meaning(name, dict(labels))
        if name in taken or m.quantity not in MEASURES or (m.commanded and not m.quantity):
            continue
        stem, unit, joint = _split(name, m.quantity, joints, labels)
        column = _Column(name, stem, "" if m.commanded else m.quantity, unit, joint)
        if column.stem and not set(column.stem.split("_")) & APART:
            groups.setdefault(column.stem, []).append(column)
    found = {}
    for stem, group in groups.items():
        placed = _placed(group, out.joints, _numbered(angles, out.joints, count))
        units = {column.unit for column in group} - {""}
        if placed and len(units) < 2 and any(np.ptp(values.span(table.columns[column.name])) > 0 for column in group):
            found[stem] = placed
    for stem, placed in found.items():
        name = _named(stem, found)
        if name is not None:
            _propose(out, table, name, placed)
    if unstated := [name for name, said in out.recording.get("signals", {}).items() if said["unit"] == UNKNOWN]:
        which = ", ".join(unstated)
        out.doubts.append(f"no name states the unit of {which}: write it in place of `{UNKNOWN}` under `signals`")


def _propose(out: Proposal, table: Table, name: str, placed: Mapping[str, _Column]) -> None:
    stated = {column.unit for column in placed.values()}
    unit = stated.pop() if len(stated) == 1 else ""
    for joint, column in placed.items():
        low, high = values.span(table.columns[column.name])
        said = f"the name says {unit}" if unit else "no unit stated"
        why = f"a signal of your own: {column.stem!r}, {low:.4g} to {high:.4g}; {said}"
        out.lines.append(Line(f"{name}.{joint}", column.name, "", why, "stated" if unit else "likely", bool(unit)))
        out.unused.pop(column.name, None)
    out.recording.setdefault("signals", {})[name] = {"unit": unit or UNKNOWN}


def _split(
    name: str, quantity: str, joints: Sequence[str], labels: Mapping[str, str]
) -> tuple[str, str, str | int | None]:
    """Split the name of a column into stem, unit and joint, as in `_Column`."""
    unit, rest = _unit(name, quantity, joints)
    words = split(rest)
    given = labels.get(name)
    called = [given] if given in joints else [joint for joint in joints if _place(split(joint), words) is not None]
    if called:
        joint = max(called, key=lambda j: len(split(str(j))))
        parts = split(str(joint))
        at = _place(parts, words)
        words = words if at is None else words[:at] + words[at + len(parts) :]
        return "_".join(word for word in words if not word.isdigit()), unit, joint
    numbers = [i for i, word in enumerate(words) if word.isdigit()]
    if not numbers:
        return "_".join(words), unit, None
    at = numbers[-1]
    return "_".join(words[:at] + words[at + 1 :]), unit, int(words[at])


def _unit(name: str, quantity: str, joints: Sequence[str]) -> tuple[str, str]:
    """Return the unit that a name states, or "", and the name without it."""
    found = [re.search(BRACKETED, name), re.search(WORDED, name), ampere(name) if quantity == "current" else None]
    for hit in [hit for hit in found if hit is not None]:
        text = hit[hit.lastindex or 0]
        if split(text) not in [split(joint) for joint in joints]:
            return text, f"{name[: hit.start()]}_{name[hit.end() :]}"
    m = meaning(name, {})
    return m.unit, bare(name) if m.unit else name


def _place(part: Sequence[str], words: Sequence[str]) -> int | None:
    """Return the index in `words` at which the words of `part` stand in sequence; None if they do not."""
    n = len(part)
    return next((i for i in range(len(words) - n + 1) if [*words[i : i + n]] == [*part]), None)


def _numbered(angles: Mapping[str, str], named: Sequence[str], count: int) -> list[str]:
    """Return the joints in the order of the numbers in their angles' columns, else the robot's, if all are there."""
    numbers = {joint: re.findall(r"\d+", bare(column)) for column, joint in angles.items()}
    last = {joint: int(found[-1]) for joint, found in numbers.items() if found}
    if len(set(last.values())) == len(named):
        return sorted(named, key=last.__getitem__)
    return [*named] if len(named) == count else []


def _placed(group: Sequence[_Column], named: Sequence[str], order: Sequence[str]) -> dict[str, _Column]:
    """Return joint -> column if a group has exactly one for each joint of `named`; else nothing."""
    by = {column.joint: column for column in group}
    if len(by) == len(group) and set(by) == set(named):
        return {joint: by[joint] for joint in named}
    numbers = sorted(column.joint for column in group if isinstance(column.joint, int))
    if numbers not in ([*range(len(order))], [*range(1, len(order) + 1)]) or len(numbers) != len(group) or not order:
        return {}
    return {joint: by[numbers[0] + order.index(joint)] for joint in named}


def _named(stem: str, found: Mapping[str, Mapping[str, _Column]]) -> str | None:
    """Return the name of a signal: its quantity, if no other signal is of it, else its stem; None if it cannot be."""
    quantities = {other: next(iter(placed.values())).quantity for other, placed in found.items()}
    quantity = quantities[stem]
    name = quantity if quantity and [*quantities.values()].count(quantity) == 1 else stem
    return name if name.isidentifier() and name not in (*SIGNALS, "time", "episode") else None
