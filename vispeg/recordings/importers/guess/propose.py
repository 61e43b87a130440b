"""Propose a map from column names and values, with a reason for each column."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypedDict

import numpy as np

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.columns import SPATIAL_SIGNALS, columns_of
from vispeg.recordings.importers.guess import values
from vispeg.recordings.importers.guess.names import (
    FILL,
    OTHER,
    TIME,
    TORQUE,
    VELOCITY,
    Meaning,
    bare,
    meaning,
    split,
)
from vispeg.recordings.importers.guess.ticks import Decoded, decoded
from vispeg.recordings.importers.guess.values import Sure, Unit
from vispeg.recordings.importers.mapping import FACTORS
from vispeg.recordings.importers.slopes import TOGETHER, slope
from vispeg.recordings.tables.table import Dialect, Table

NAMES = {"q": "measured angle", "dq": "measured speed", "tau": "measured torque", "q_cmd": "commanded angle",
         "dq_cmd": "commanded speed", "tau_cmd": "commanded torque"}  # fmt: skip
SECONDS, NANOS = ("s", "sec", "secs", "seconds"), ("ns", "nsec", "nsecs", "nanosec", "nanos", "nanoseconds")
SIGNALS = ("q", "dq", "tau")  # quantities that are read, measured or commanded
SHOWN = 8  # numbers shown of a row
NO_READING = "no readings"
ORDER = ("q", "dq", "tau", "tau_cmd", "q_cmd", "dq_cmd")  # of the map's lines


@dataclass(frozen=True)
class Line:
    """One line of a proposed map: a column of the recording and its source.

    Attributes:
        target: column of the recording.
        column: column of the source file; empty for a signal that is declared missing.
        unit: unit of the source's values.
        why: reason for the choice, in words.
        sure: certainty: `stated` by the file, `measured` from its numbers, or `likely`.
        named: whether the column's name states the unit.
        scale: factor on the values in addition to that of the unit.
        offset: SI units, added last.
        plus: a further column to be added, and its unit.
        rate_hz: sample rate, Hz, if the file has no time stamps.
        constant: torque constant, N m/A, if the column is a current.
    """

    target: str
    column: str
    unit: str
    why: str
    sure: Sure = "likely"
    named: bool = False
    scale: float = 1.0
    offset: float = 0.0
    plus: tuple[str, str] | None = None
    rate_hz: float | None = None
    constant: float | None = None


class Stated(TypedDict, total=False):
    """Keys of recording.yaml whose values can be guessed from a file's columns."""

    joints: list[str]
    torque_sensor: str
    control: dict[str, str]
    signals: dict[str, dict[str, str]]


@dataclass
class Proposal:
    """A proposed map, to be confirmed by the user.

    Attributes:
        file: the source file.
        lines: the map's lines, one for each column of the recording.
        joints: joints for which columns were found, in the robot's order.
        recording: proposed keys of recording.yaml.
        dialect: cell separator and decimal mark of a text table.
        doubts: sentences about what the user should check, except the one about the torque sensor.
        sensor_doubt: what the user should check about the torque sensor, or empty.
        unused: source column -> why it is not used.
        assumed: signals whose columns are in an assumed joint order.
        current: whether "measured torque" is a motor current, whose scale to N m has to be found.
        motors: joint -> joint angle over motor angle, as in a map file, for joints whose columns are motor readings.
        ampere: the unit that the names of these currents state, A or mA.
        rows: the rows of the file that decided between units, as text.
    """

    file: Path
    lines: list[Line]
    joints: list[str]
    recording: Stated
    dialect: Dialect
    doubts: list[str] = field(default_factory=list)
    sensor_doubt: str = ""
    unused: dict[str, str] = field(default_factory=dict)
    assumed: set[str] = field(default_factory=set)
    current: bool = False
    motors: dict[str, str] = field(default_factory=dict)
    ampere: str = ""
    rows: list[str] = field(default_factory=list)

    def signals(self) -> set[str]:
        """Names of the signals that were found."""
        return {line.target.partition(".")[0] for line in self.lines}

    def set_sensor(self, sensor: str | None, doubt: str = "") -> None:
        """Set the kind of torque sensor, None where none is proposed; `doubt` replaces the earlier one about it."""
        if sensor is None:
            self.recording.pop("torque_sensor", None)
        else:
            self.recording["torque_sensor"] = sensor
        self.sensor_doubt = doubt


def propose(
    table: Table,
    joints: Sequence[str],
    limits: Limits,
    dialect: Dialect,
    labels: dict[str, str],
    *,
    order: Sequence[int] | None = None,
    rate_hz: float | None = None,
    calibration: Mapping[str, int] | None = None,
) -> Proposal:
    """Guess the meaning of a table's columns.

    Args:
        table: all columns of the source, or the first rows of them.
        joints: the robot's joints.
        limits: limits of these joints; units are chosen so that angles and speeds respect them.
        dialect: cell separator and decimal mark of the table.
        labels: column -> joint, where known from a source other than the name (`labelled`).
        order: for each joint, the index of its column, if the file states no order.
        rate_hz: samples per second, for a file without time stamps.
        calibration: joint -> width of its calibrated range, encoder ticks.

    Raises:
        UserError: no column can be the time, no columns can be the angles, or a column of either, of speeds or torques
            holds numbers and other cells; or there is one sample only.
    """
    if table.rows == 1:
        raise UserError("holds a single sample", file=table.file, expected="a motion")
    meanings = own_names([meaning(name, labels) for name in table.names], joints, table)
    out = Proposal(table.file, [], [], {}, dialect)
    for m in meanings:
        if m.name in table.mixed and m.quantity in (*SIGNALS, "time", "episode"):
            table.number(m.name)  # raises: its cells that are not numbers are no reason to do without the others
    numeric = [m for m in meanings if m.name in table.columns]
    silent = {m.name for m in numeric if not np.isfinite(table.columns[m.name]).any()}
    out.unused |= dict.fromkeys(silent, NO_READING)
    # a joint without torque may be in a recording, one without angles cannot
    numeric = [m for m in numeric if m.name not in silent or (m.quantity in ("tau", "current") and not m.commanded)]
    groups = _groups([m for m in numeric if m.quantity in SIGNALS])
    chosen = _chosen(groups, out)
    if "tau" not in chosen:
        currents = _groups([m for m in numeric if m.quantity == "current"])
        measured = [group for (_, commanded, _), group in currents.items() if not commanded]
        if measured:
            chosen["tau"], out.current = max(measured, key=len), True
    placed = {signal: joint_columns(group, joints, signal, out, order) for signal, group in chosen.items()}
    placed = {signal: columns for signal, columns in placed.items() if columns}
    if "q" not in placed:
        expected = "names such as q1, position_0, joint1.pos, actual_q_0; for others, write a map"
        raise UserError("no columns look like measured angles", file=table.file, expected=expected, choices=table.names)
    out.joints = [joint for joint in joints if joint in placed["q"]]
    if "q_cmd" not in placed and (goals := _goals(table, numeric, placed["q"], joints, order)):
        placed["q_cmd"] = goals
    for signal in [s for s in placed if s != "q"]:
        found = placed[signal]
        out.unused |= {found[j].name: "its joint has no measured angle" for j in found if j not in out.joints}
        placed[signal] = {j: m for j, m in found.items() if j in out.joints}
        if set(placed[signal]) != set(out.joints):
            lacking = [j for j in out.joints if j not in placed[signal]]
            out.doubts.append(f"{NAMES[signal]}s are not there for every joint (not {', '.join(lacking)}): left out")
            out.unused |= {m.name: "not there for every joint" for m in placed.pop(signal).values()}
    if "tau" in placed and all(values.span(table.columns[m.name])[0] >= 0 for m in placed["tau"].values()):
        out.unused |= {
            m.name: "never negative: the size of a torque without its sign"
            for m in placed.pop("tau").values()
            if m.name not in silent
        }
    places = [list(joints).index(joint) for joint in out.joints]
    selected = Limits(limits.range[places], limits.velocity[places], limits.torque[places])
    stacks = {s: _stack(table, [placed[s][j] for j in out.joints]) for s in placed}
    ticks = _ticks(placed["q"], stacks, out, calibration)
    known = {s: Unit("tick", "encoder ticks") for s in ("q", "q_cmd") if s in placed and any(ticks)}
    if out.current and "tau" in placed:
        known["tau"], out.ampere = Unit("", "a motor current"), _amperes(placed["tau"])
    columns = {s: [placed[s][j] for j in out.joints] for s in placed}
    units = values.units_of(columns, stacks, selected, out.doubts, known)
    speeds = {s: _speeds(columns[s]) for s in ("dq", "dq_cmd") if s in placed}
    time = _time(table, meanings, stacks, units, selected, speeds.get("dq", ()), out, rate_hz)
    out.lines.append(time)
    clock = seconds(table, time)
    for signal, possible in speeds.items():
        angle = "q_cmd" if signal == "dq_cmd" and "q_cmd" in placed else "q"
        q = stacks[angle] * FACTORS[units[angle].name]
        units[signal] = values.speed_unit(clock, q, stacks[signal], units[signal], possible)
    episode = next((m.name for m in meanings if m.quantity == "episode" and m.name in table.columns), None)
    if episode is not None and values.all_integers(table.columns[episode]):
        out.lines.append(Line("episode", episode, "", "its name says that it counts runs", "stated"))
    for signal in sorted(placed, key=ORDER.index):
        unit = units[signal]
        for joint, tick, low_end in zip(out.joints, ticks, selected.range[:, 0], strict=True):
            m = placed[signal][joint]
            if m.name in silent:
                out.lines.append(Line(f"{signal}.{joint}", "", "", f"{NAMES[signal]}: {NO_READING}", "measured"))
                continue
            low, high = values.span(table.columns[m.name])
            called = m.said if m.by == "other" else f"{m.said!r}{' of ' + repr(m.label) if m.label else ''}"
            words = f"{NAMES[signal]}: {called}, {low:.4g} to {high:.4g}"
            of, scale = (unit, 1.0) if tick is None or unit.name != "tick" else (_tick_unit(tick), tick.scale)
            gripper = of.name == "tick" and tick is not None and tick.full == 100 and np.isfinite(low_end)
            offset = float(f"{low_end:.6g}") if gripper else 0.0
            out.lines.append(
                Line(f"{signal}.{joint}", m.name, of.name, f"{words}; {of.why}", of.sure, of.named, scale, offset)
            )
    for signal in SPATIAL_SIGNALS:
        own = columns_of(signal, ())
        if set(own) <= {m.name for m in numeric}:
            out.lines += [Line(name, name, "", "a recording's column has this name", "stated") for name in own]
    out.rows = _rows(table, out, time)
    _leftover(table, meanings, out)
    if len(out.joints) < len(joints):
        out.recording["joints"] = out.joints
        held = ", ".join(joint for joint in joints if joint not in out.joints)
        out.doubts.append(
            f"the robot has {len(joints)} joints, the file {len(out.joints)}: held at rest, their mass stays: {held}"
        )
    if "tau" in placed:
        _sensor([m.name for m in placed["tau"].values()], out)
    elif "q_cmd" in placed:
        _servo(stacks, units, out)
    return out


def _goals(
    table: Table,
    meanings: Sequence[Meaning],
    angles: Mapping[str, Meaning],
    joints: Sequence[str],
    order: Sequence[int] | None,
) -> dict[str, Meaning]:
    """Return joint -> column for commands whose names state no quantity and that the angles follow; else nothing."""
    groups = _groups([m for m in meanings if m.commanded and not m.quantity])
    for group in groups.values():
        aside = Proposal(table.file, [], [], {}, Dialect())  # collects doubts about columns that may not be used
        placed = joint_columns(group, joints, "q_cmd", aside, order)
        if not set(angles) <= set(placed):
            continue
        q, goal = (_stack(table, [columns[joint] for joint in angles]) for columns in (angles, placed))
        ratio = slope(goal - np.nanmean(goal, axis=0), q - np.nanmean(q, axis=0))
        if ratio is not None and any(0.5 < ratio * k < 2.0 for k in (1.0, FACTORS["deg"], 1 / FACTORS["deg"])):
            said = "a command of no stated quantity, which the angles follow"
            return {joint: replace(m, quantity="q", said=said, by="other") for joint, m in placed.items()}
    return {}


def own_names(meanings: list[Meaning], joints: Sequence[str], table: Table) -> list[Meaning]:
    """Complete the meanings: a column named as a joint holds angles, or the quantity that the file's name states.

    So do columns that differ from those by their numbers alone: `joint0` beside `joint1`.
    """
    full = {"_".join(split(joint)): joint for joint in joints}
    short = {"_".join(word for word in split(joint) if word not in FILL): joint for joint in joints}
    joint_of = full | {label: joint for label, joint in short.items() if label and not label.isdigit()}
    words = {m.name: split(bare(m.name)) for m in meanings if not m.quantity}
    found = {name: joint_of[key] for name, parts in words.items() if (key := "_".join(parts)) in joint_of}
    if len(set(found.values())) < min(2, len(joints)):
        return meanings
    stems = {_unnumbered(words[name]) for name in found if any(word.isdigit() for word in words[name])}
    found = {name: found.get(name, bare(name)) for name in words if name in found or _unnumbered(words[name]) in stems}
    file = set(split(table.file.name))
    quantity = "dq" if file & VELOCITY else "tau" if file & TORQUE else "q"
    said = "the joint's own name"
    return [
        replace(m, quantity=quantity, label=found[m.name], said=said, by="other") if m.name in found else m
        for m in meanings
    ]


def _unnumbered(words: Sequence[str]) -> tuple[str, ...]:
    """Return the words of a name with its numbers left open."""
    return tuple("#" if word.isdigit() else word for word in words)


def _ticks(
    columns: Mapping[str, Meaning], stacks: dict[str, np.ndarray], out: Proposal, calibration: Mapping[str, int] | None
) -> list[Decoded | None]:
    """Find how normalised values convert to encoder ticks, and convert the stacks of angles and goals in place."""
    if {m.unit for m in columns.values()} - {""}:
        return [None] * len(out.joints)
    names = [columns[joint].label or joint for joint in out.joints]
    ticks = decoded(
        stacks["q"], [f"{name} {joint}" for name, joint in zip(names, out.joints, strict=True)], calibration
    )
    if not any(ticks):
        return ticks
    for signal in ("q", "q_cmd"):
        if signal in stacks:
            stacks[signal] = stacks[signal] * [1.0 if tick is None else tick.scale for tick in ticks]
    guessed = [j for j, tick in zip(out.joints, ticks, strict=True) if tick is not None and not tick.sure]
    if guessed:
        what = "hardly move, so that the values do not tell their range: it is taken to be as wide as the others'"
        out.doubts.append(f"{', '.join(guessed)} {what}; a calibration file gives it")
    out.doubts.append(
        "normalised units: 0 is the middle of a joint's calibrated range, which is the zero of so101_new_calib.xml and "
        "its like; 0 % of a gripper is its closed end, which is taken to be the joint's lower limit in the model"
    )
    return ticks


def _tick_unit(tick: Decoded) -> Unit:
    """Return the unit of one joint's normalised values, with what its range is known by."""
    what = f"{'per cent' if tick.full == 100 else '-100 to 100'} of {tick.span} encoder ticks"
    if not tick.sure:
        return Unit("tick", f"{what}, which is a guess")
    if not tick.values:
        return Unit("tick", f"{what}, as its calibration says", "stated")
    return Unit("tick", f"{what}, of which all {tick.values} values are whole numbers", "measured")


def _rows(table: Table, out: Proposal, time: Line) -> list[str]:
    """Return the rows that help to decide between units: the first, the one with the largest angle, and the last."""
    columns = [line.column for line in out.lines if line.target.startswith("q.")]
    stack = np.stack([table.columns[name] for name in columns], axis=1)
    peak = int(np.argmax(np.nanmax(np.abs(np.nan_to_num(stack)), axis=1)))
    out_rows = []
    for row in dict.fromkeys((0, peak, table.rows - 1)):
        numbers = ", ".join(f"{value:.6g}" for value in stack[row, :SHOWN]) + (", .." if len(columns) > SHOWN else "")
        at = f"{time.column} {table.columns[time.column][row]:.10g}: " if time.column else ""
        out_rows.append(f"{table.row(row)}: {at}{numbers}")
    return out_rows


def seconds(table: Table, time: Line) -> np.ndarray:
    """Compute the time (n,) in s from the map line of the time."""
    if time.rate_hz is not None:
        return np.arange(table.rows) / time.rate_hz
    whole = table.columns[time.column] * FACTORS[time.unit]
    return whole if time.plus is None else whole + table.columns[time.plus[0]] * FACTORS[time.plus[1]]


def _servo(stacks: dict[str, np.ndarray], units: Mapping[str, Unit], out: Proposal) -> None:
    """Propose servo control if there are goals and angles but no torque, and the angles follow the goals."""
    q, goal = (stacks[s] * FACTORS[units[s].name] for s in ("q", "q_cmd"))
    ratio = slope(goal - np.nanmean(goal, axis=0), q - np.nanmean(q, axis=0))
    if ratio is None or not 0.5 < ratio < 2.0:
        out.doubts.append("the measured angles do not follow the goals: what drove the robot is not known")
        return
    out.recording["control"] = {"mode": "servo"}
    out.doubts.append(
        "control: servo is proposed, as there are goals and angles, no torque and no gains: each joint's own loop is "
        "fitted; with its gains in N m/rad say mode: position, kp, kd"
    )


def labelled(table: Table, stated: dict[str, str]) -> dict[str, str]:
    """Find joint names in cells: `field.name0` = shoulder labels position0; `name` = [shoulder, elbow] labels all."""
    labels = dict(stated)
    for name, (_, cell) in table.text.items():
        if "name" not in split(name) and "names" not in split(name):
            continue
        listed = re.findall(r"[A-Za-z_][\w./-]*", cell) if re.match(r"\s*[\[({]", cell) or "," in cell else []
        if listed:  # bagpy, pandas: the list of a message's names in a column
            for other in table.columns:
                numbers = re.findall(r"\d+", other)
                if numbers and int(numbers[-1]) < len(listed) and split(other)[-1:] == [str(int(numbers[-1]))]:
                    labels.setdefault(other, listed[int(numbers[-1])])
            continue
        numbers = re.findall(r"\d+", name)
        if numbers and re.fullmatch(r"[A-Za-z]\w*", cell.strip()):
            for other in table.columns:
                if re.findall(r"\d+", other)[-1:] == numbers[-1:] and split(other)[:-2] == split(name)[:-2]:
                    labels[other] = cell.strip()
    return labels


def _groups(meanings: list[Meaning]) -> dict[tuple[str, bool | None, str], list[Meaning]]:
    """Group columns by quantity, measured or commanded, and wording."""
    groups: dict[tuple[str, bool | None, str], list[Meaning]] = {}
    for m in meanings:
        groups.setdefault((m.quantity, m.commanded, m.said), []).append(m)
    return groups


def _chosen(groups: dict[tuple[str, bool | None, str], list[Meaning]], out: Proposal) -> dict[str, list[Meaning]]:
    """Choose one group of columns for each signal, the highest by `_rank`; the others become unused."""
    best: dict[str, list[Meaning]] = {}
    for (quantity, commanded, _), group in sorted(groups.items(), key=_rank):
        signal = quantity + ("_cmd" if commanded else "")
        if signal in best:
            rival = best[signal][0].name
            out.unused |= {m.name: f"{rival} and its like are taken for the {NAMES[signal]}s" for m in group}
        else:
            best[signal] = group
    return best


def _rank(group: tuple[tuple[str, bool | None, str], list[Meaning]]) -> tuple[bool, bool, int]:
    """Rank groups: names that state the quantity first, then those that say measured or commanded, then the largest."""
    (_, commanded, _), columns = group
    return columns[0].by != "word", commanded is None, -len(columns)


def joint_columns(
    group: list[Meaning], joints: Sequence[str], signal: str, out: Proposal, order: Sequence[int] | None = None
) -> dict[str, Meaning]:
    """Return joint -> column: matched by the joint's name, else by number, else by place in the file or in `order`."""
    named, numbered = _by_name(group, joints), _by_number(group)
    if named and len(named) >= sum(k < len(joints) for k in numbered):  # joint0 .. of a robot's joint1 .. are numbers
        _others(group, named, signal, out)
        return {joint: columns[0] for joint, columns in named.items()}
    if numbered:
        out.unused |= {m.name: "the robot has fewer joints" for k, m in numbered.items() if k >= len(joints)}
        doubt = "no column names the joints: taken by their numbers in the robot's order"
        if doubt not in out.doubts:
            out.doubts.append(doubt)
        out.assumed.add(signal)
        return _ordered({joints[k]: m for k, m in sorted(numbered.items()) if k < len(joints)}, order)
    if len(group) == 1 and len(joints) > 1 or len(group) > len(joints):
        why = f"{count(len(group), 'column')}, {count(len(joints), 'joint')}, and no name or number says which is which"
        out.unused |= {m.name: why for m in group}
        return {}
    pairs = _ordered(dict(zip(joints, group, strict=False)), order)
    which = ", ".join(f"{m.label or m.name} is {joint}" for joint, m in pairs.items())
    doubt = f"no column is called as the robot's joints are: taken in the file's order ({which})"
    if doubt not in out.doubts:
        out.doubts.append(doubt)
    out.assumed.add(signal)
    return pairs


def _ordered(pairs: dict[str, Meaning], order: Sequence[int] | None) -> dict[str, Meaning]:
    """Reorder columns: the `i`-th joint gets the column of the `order[i]`-th joint."""
    if order is None or len(order) != len(pairs):
        return pairs
    names, columns = list(pairs), list(pairs.values())
    return {name: columns[k] for name, k in zip(names, order, strict=True)}


def _by_number(group: list[Meaning]) -> dict[int, Meaning]:
    """Return place in the robot's order -> column, by the columns' numbers from 0 or 1; empty without such numbers."""
    for labels in (_bare([m.label for m in group]), _bare(["_".join(split(bare(m.name))) for m in group])):
        if all(label.isdigit() for label in labels) and len(set(labels)) == len(labels):
            first = min(int(label) for label in labels)
            return {int(label) - (1 if first >= 1 else 0): m for label, m in zip(labels, group, strict=True)}
    return {}


def _others(group: list[Meaning], named: Mapping[str, list[Meaning]], signal: str, out: Proposal) -> None:
    """Record which columns of a group are of no joint, or of one that another column is taken for: a doubt."""
    rivals = {m.name: columns[0].name for columns in named.values() for m in columns[1:]}
    out.unused |= {name: f"{first} is taken for the {NAMES[signal]}" for name, first in rivals.items()}
    placed = {m.name for columns in named.values() for m in columns}
    out.unused |= {m.name: "of no joint of this robot" for m in group if m.name not in placed}
    if rivals:
        other, first = next(iter(rivals.items()))
        out.doubts.append(f"several columns are the {NAMES[signal]} of one joint: {first} and its like, not {other}")


def _by_name(group: list[Meaning], joints: Sequence[str]) -> dict[str, list[Meaning]]:
    """Return joint -> columns in the file's order that are labelled with its name, or with what distinguishes it."""
    short = dict(zip(_bare(["_".join(split(j)) for j in joints]), joints, strict=True))
    full = {"_".join(split(joint)): joint for joint in joints}
    columns: dict[str, list[Meaning]] = {}
    for m in group:
        words = "_".join(split(m.label))
        name = "_".join(split(m.name))
        hits = [n for n in full if re.search(rf"(?<![a-z0-9]){re.escape(n)}(?![0-9a-z])", name)]
        joint = full[max(hits, key=len)] if hits else full.get(words)
        joint = short.get(words) if joint is None and not words.isdigit() else joint
        if joint is not None:
            columns.setdefault(joint, []).append(m)
    return columns if len(columns) > 1 or len(joints) == 1 else {}


def _bare(labels: list[str]) -> list[str]:
    """Strip the common prefix and suffix of labels: j1, j2 -> 1, 2. Numbers are not split."""
    if len(labels) < 2:
        return [re.sub(r"^\D+(?=\d+$)", "", label) for label in labels]
    head = re.sub(r"\d+$", "", os.path.commonprefix(labels))
    tail = re.sub(r"^\d+", "", os.path.commonprefix([label[::-1] for label in labels])[::-1])
    cut = [label[len(head) : len(label) - len(tail)] for label in labels]
    return [label.strip("_") for label in cut] if all(cut) else labels


def _stack(table: Table, columns: list[Meaning]) -> np.ndarray:
    """Return the columns as one array (n, nj); an infinite reading, which tells nothing about a unit, is missing."""
    stack = np.stack([table.columns[m.name] for m in columns], axis=1)
    return np.where(np.isfinite(stack), stack, np.nan)


def _time(
    table: Table,
    meanings: list[Meaning],
    stacks: dict[str, np.ndarray],
    units: Mapping[str, Unit],
    limits: Limits,
    speeds: Sequence[str],
    out: Proposal,
    rate_hz: float | None = None,
) -> Line:
    """Find the time: an increasing column named like a time, else one with even steps, else a sample rate."""
    if rate_hz is not None:
        return Line("time", "", "", f"the file is read at {rate_hz:g} Hz, as stated", "stated", rate_hz=rate_hz)
    pair = _pair(table, meanings)
    if pair is not None:
        return Line("time", pair[0], "s", "seconds, and nanoseconds beside them", "stated", plus=(pair[1], "ns"))
    named = [
        m
        for m in meanings
        if m.name in table.columns and (m.quantity == "time" or m.name in table.dates or set(split(m.name)) & TIME)
    ]
    running = [m for m in named if values.increases(table.columns[m.name])]
    if not running:
        for name, there in ((m.name, np.isfinite(table.columns[m.name])) for m in named):
            if not there.all() and values.increases(table.columns[name][there]):
                key = f"{table.row(np.flatnonzero(~there)[0])}, column {name}"
                expected = "a time in every row; or --rate-hz, how many samples a second there are"
                raise UserError("is missing or infinite", file=table.file, key=key, expected=expected)
        taken = {line.column for line in out.lines}
        running = [m for m in meanings if m.name in table.columns and m.name not in taken and not m.quantity]
        running = [m for m in running if values.increases(table.columns[m.name], even=True)]
        if not running and (found := _rate(stacks, units)) is not None:
            why = "no column is the time; at this rate the measured speeds are the change of the angles"
            return Line("time", "", "", why, "measured", rate_hz=found)
        if not running:
            expected = "one that increases; or --rate-hz, how many samples a second there are"
            raise UserError("no column looks like the time", file=table.file, expected=expected, choices=table.names)
        out.doubts.append(f"no column is called time: {running[0].name} increases by even steps")
    best = min(running, key=lambda m: ("nano" in m.name or "nsec" in split(m.name), len(split(m.name))))
    for other in running:
        if other is not best:
            out.unused[other.name] = f"{best.name} is taken for the time"
    if best.name in table.dates:
        return Line("time", best.name, "s", "dates or times of day", "measured")
    unit = values.time_unit(table.columns[best.name], best.unit, stacks, units, limits, out.doubts, speeds)
    return Line("time", best.name, unit.name, unit.why, unit.sure, unit.named)


def _rate(stacks: Mapping[str, np.ndarray], units: Mapping[str, Unit]) -> float | None:
    """Return the sample rate at which measured speeds match the slope of the angles, Hz; None if unknown."""
    if "dq" not in stacks:
        return None
    q, dq = (stacks[signal] * FACTORS[units[signal].name] for signal in ("q", "dq"))
    step, speed = np.diff(q, axis=0), 0.5 * (dq[1:] + dq[:-1])
    usual = np.abs(step) <= 3 * np.nanquantile(np.abs(step), 0.99, axis=0)  # excludes jumps between episodes
    rate = slope(np.where(usual, step, np.nan), speed, TOGETHER)
    if rate is None or not values.RATES[0] <= rate <= values.RATES[1]:
        return None
    return float(round(rate)) if abs(rate / round(rate) - 1) < 0.01 else rate


def _pair(table: Table, meanings: list[Meaning]) -> tuple[str, str] | None:
    """Return the seconds and nanoseconds columns of a split time stamp (as of ROS or KUKA); None without one."""
    names = [m.name for m in meanings if m.name in table.columns]
    for fine in names:
        words = _before(fine, NANOS)
        if words is None:
            continue
        for coarse in names:
            if _before(coarse, SECONDS) == words:
                nanos, whole = table.columns[fine], table.columns[coarse]
                total = whole + 1e-9 * nanos
                if values.all_integers(whole) and 0 <= values.span(nanos)[0] and values.increases(total):
                    return coarse, fine
    return None


def _before(name: str, units: Sequence[str]) -> list[str] | None:
    """Return the words before a unit at a name's end, which may be two words (NanoSec); None without such a unit."""
    words = split(name)
    return next((words[:-n] for n in (1, 2) if "".join(words[-n:]) in units), None)


def _speeds(columns: list[Meaning]) -> tuple[str, ...]:
    """Return the units that speeds may be in: the one stated in their names, else all."""
    stated = {m.unit for m in columns} - {""}
    return (*stated,) if len(stated) == 1 and stated <= values.STATED else values.SPEEDS


def _leftover(table: Table, meanings: list[Meaning], out: Proposal) -> None:
    """Record why each remaining column is not used."""
    taken = {line.column for line in out.lines} | {line.plus[0] for line in out.lines if line.plus is not None}
    for m in meanings:
        if m.name in taken or m.name in out.unused:
            continue
        if m.name in table.text:
            out.unused[m.name] = "no numbers"
        elif m.quantity in OTHER:
            out.unused[m.name] = OTHER[m.quantity][1]
        elif m.commanded and not m.quantity:
            out.unused[m.name] = "a command of no stated quantity, which the angles do not follow"
        else:
            out.unused[m.name] = "its name is of no known signal"


def _amperes(columns: Mapping[str, Meaning]) -> str:
    """Return the unit that the names of all currents state, or ""."""
    stated = {m.unit for m in columns.values()}
    return stated.pop() if len(stated) == 1 else ""


def _sensor(names: list[str], out: Proposal) -> None:
    """Propose the kind of torque sensor, as far as column names tell it."""
    words = {word for name in names for word in split(name)}
    if all(re.search(r"tau_?J(?![a-z])", name) for name in names):
        sensor, why = "joint", "from the name (as Franka's tau_J); say motor if it comes from a current"
    elif {"load", "effort", "current", "moment"} & words:
        sensor, why = "motor", "as a load or effort mostly comes from a current; say joint for a sensor behind the gear"
    else:
        out.set_sensor(None, "no name states where torque was measured; it is not used until you state joint or motor")
        return
    out.set_sensor(sensor, f"{sensor} is guessed {why}")
