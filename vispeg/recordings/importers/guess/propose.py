"""A map proposed from what the names say and the numbers allow, with a reason for each column."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypedDict

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.importers.guess import values
from vispeg.recordings.importers.guess.names import OTHER, TIME, Meaning, meaning, split
from vispeg.recordings.importers.mapping import FACTORS
from vispeg.recordings.tables.table import Dialect, Table

NAMES = {"q": "measured angle", "dq": "measured speed", "tau": "measured torque", "q_cmd": "commanded angle",
         "dq_cmd": "commanded speed", "tau_cmd": "commanded torque"}  # fmt: skip
ORDER = ("q", "dq", "tau", "tau_cmd", "q_cmd", "dq_cmd")


@dataclass(frozen=True)
class Line:
    """One column of the map: what it becomes, which column it is, its unit, and why."""

    target: str
    column: str
    unit: str
    why: str


class Stated(TypedDict, total=False):
    """Keys of recording.yaml that a file's columns say something about."""

    joints: list[str]
    torque_sensor: str


@dataclass
class Proposal:
    """A map to be confirmed.

    Attributes:
        file: the source.
        lines: columns of the recording.
        joints: those that were found, in the robot's order.
        recording: keys of recording.yaml.
        dialect: of a text table.
        doubts: sentences on what a person should look at.
        unused: column -> why it is not used.
    """

    file: Path
    lines: list[Line]
    joints: list[str]
    recording: Stated
    dialect: Dialect
    doubts: list[str] = field(default_factory=list)
    unused: dict[str, str] = field(default_factory=dict)

    def signals(self) -> set[str]:
        """Names of the signals that were found."""
        return {line.target.partition(".")[0] for line in self.lines}


def propose(
    table: Table, joints: Sequence[str], limits: Limits, dialect: Dialect, labels: dict[str, str] | None = None
) -> Proposal:
    """Guesses what the columns of a table are.

    Args:
        table: all columns of the source, or the first rows of them.
        joints: the robot's joints.
        limits: of these joints; what angles and speeds are held against.
        dialect: how the table is written.
        labels: column -> joint, where something beside the header says so.

    Raises:
        UserError: no column can be the time, or none the angles.
    """
    meanings = [meaning(name, _labels(table, labels or {})) for name in table.names]
    out = Proposal(table.file, [], [], {}, dialect)
    groups = _groups([m for m in meanings if m.name in table.columns and m.quantity in ("q", "dq", "tau")])
    chosen = _chosen(groups, out)
    placed = {signal: _placed(group, joints, signal, out) for signal, group in chosen.items()}
    placed = {signal: columns for signal, columns in placed.items() if columns}
    if "q" not in placed:
        expected = "names such as q1, position_0, joint1.pos, actual_q_0; a map of your own says it otherwise"
        raise UserError("no columns look like measured angles", file=table.file, expected=expected, choices=table.names)
    out.joints = [joint for joint in joints if joint in placed["q"]]
    for signal in [s for s in placed if s != "q"]:
        if set(placed[signal]) != set(out.joints):
            lacking = [j for j in out.joints if j not in placed[signal]]
            out.doubts.append(f"{NAMES[signal]}s are not there for every joint (not {', '.join(lacking)}): left out")
            out.unused |= {m.name: "not there for every joint" for m in placed.pop(signal).values()}
    if "tau" in placed and all(values.span(table.columns[m.name])[0] >= 0 for m in placed["tau"].values()):
        out.unused |= {
            m.name: "never negative: the size of a torque without its sign" for m in placed.pop("tau").values()
        }
    order = [list(joints).index(joint) for joint in out.joints]
    selected = Limits(limits.range[order], limits.velocity[order], limits.torque[order])
    stacks = {s: _stack(table, [placed[s][j] for j in out.joints]) for s in placed}
    units = values.units_of({s: [placed[s][j] for j in out.joints] for s in placed}, stacks, selected, out.doubts)
    speeds = {s: _speeds([placed[s][j] for j in out.joints]) for s in ("dq", "dq_cmd") if s in placed}
    time = _time(table, meanings, stacks, units, selected, speeds.get("dq", ()), out)
    out.lines.append(time)
    seconds = table.columns[time.column] * FACTORS[time.unit]
    for signal, some in speeds.items():
        angle = "q_cmd" if signal == "dq_cmd" and "q_cmd" in placed else "q"
        q = stacks[angle] * FACTORS[units[angle][0]]
        units[signal] = values.speed_unit(seconds, q, stacks[signal], units[signal], some)
    episode = next((m.name for m in meanings if m.quantity == "episode" and m.name in table.columns), None)
    if episode is not None and values.all_integers(table.columns[episode]):
        out.lines.append(Line("episode", episode, "", "its name says that it counts runs"))
    for signal in sorted(placed, key=ORDER.index):
        unit, why = units[signal]
        for joint in out.joints:
            m = placed[signal][joint]
            low, high = values.span(table.columns[m.name])
            words = f"{NAMES[signal]}: {m.said!r}{' of ' + repr(m.label) if m.label else ''}, {low:.4g} to {high:.4g}"
            out.lines.append(Line(f"{signal}.{joint}", m.name, unit, f"{words}; {why}"))
    _leftover(table, meanings, out)
    if len(out.joints) < len(joints):
        out.recording["joints"] = out.joints
        held = ", ".join(joint for joint in joints if joint not in out.joints)
        out.doubts.append(
            f"the robot has {len(joints)} joints, the file {len(out.joints)}: held at rest, their mass stays: {held}"
        )
    if "tau" in placed:
        _sensor([m.name for m in placed["tau"].values()], out)
    return out


def _labels(table: Table, stated: dict[str, str]) -> dict[str, str]:
    """Columns `field.name0` = shoulder say that position0 belongs to shoulder, as ROS tools write JointState."""
    labels = dict(stated)
    for name, (_, cell) in table.text.items():
        numbers = re.findall(r"\d+", name)
        if "name" in split(name) and numbers and re.fullmatch(r"[A-Za-z]\w*", cell.strip()):
            for other in table.columns:
                if re.findall(r"\d+", other)[-1:] == numbers[-1:] and split(other)[:-2] == split(name)[:-2]:
                    labels[other] = cell.strip()
    return labels


def _groups(meanings: list[Meaning]) -> dict[tuple[str, bool | None, str], list[Meaning]]:
    """Columns of one quantity, source and wording."""
    groups: dict[tuple[str, bool | None, str], list[Meaning]] = {}
    for m in meanings:
        groups.setdefault((m.quantity, m.commanded, m.said), []).append(m)
    return groups


def _chosen(groups: dict[tuple[str, bool | None, str], list[Meaning]], out: Proposal) -> dict[str, list[Meaning]]:
    """For each signal the group that is most surely it: the one that says `actual` before others, then the largest."""
    best: dict[str, list[Meaning]] = {}
    for (quantity, commanded, _), group in sorted(groups.items(), key=lambda g: (g[0][1] is None, -len(g[1]))):
        signal = quantity + ("_cmd" if commanded else "")
        if signal in best:
            rival = best[signal][0].name
            out.unused |= {m.name: f"{rival} and its like are taken for the {NAMES[signal]}s" for m in group}
        else:
            best[signal] = group
    return best


def _placed(group: list[Meaning], joints: Sequence[str], signal: str, out: Proposal) -> dict[str, Meaning]:
    """Joint -> column: by the joint's name, else by number, else in order."""
    named = _by_name(group, joints)
    if named:
        out.unused |= {m.name: "of no joint of this robot" for m in group if m not in named.values()}
        return named
    labels = _bare([m.label for m in group])
    if all(label.isdigit() for label in labels) and len(set(labels)) == len(labels):
        first = min(int(label) for label in labels)
        numbered = {int(label) - (1 if first >= 1 else 0): m for label, m in zip(labels, group, strict=True)}
        out.unused |= {m.name: "the robot has no so many joints" for k, m in numbered.items() if k >= len(joints)}
        return {joints[k]: m for k, m in sorted(numbered.items()) if k < len(joints)}
    if len(group) == 1 and len(joints) > 1 or len(group) > len(joints):
        why = f"{len(group)} columns, {len(joints)} joints, and no name or number says which is which"
        out.unused |= {m.name: why for m in group}
        return {}
    pairs = dict(zip(joints, group, strict=False))
    order = ", ".join(f"{m.label or m.name} is {joint}" for joint, m in pairs.items())
    doubt = f"no column is called as the robot's joints are: taken in the file's order ({order})"
    if doubt not in out.doubts:
        out.doubts.append(doubt)
    return pairs


def _by_name(group: list[Meaning], joints: Sequence[str]) -> dict[str, Meaning]:
    """Columns whose label is a joint's name, or the part of it that tells it from the others."""
    short = dict(zip(_bare(["_".join(split(j)) for j in joints]), joints, strict=True))
    full = {"_".join(split(joint)): joint for joint in joints}
    columns: dict[str, Meaning] = {}
    for m in group:
        words = "_".join(split(m.label))
        name = "_".join(split(m.name))
        hits = [n for n in full if re.search(rf"(?<![a-z0-9]){re.escape(n)}(?![0-9a-z])", name)]
        joint = full[max(hits, key=len)] if hits else short.get(words) if not words.isdigit() else None
        if joint is not None:
            columns.setdefault(joint, m)
    return columns if len(columns) > 1 or len(joints) == 1 else {}


def _bare(labels: list[str]) -> list[str]:
    """Labels without what all of them begin and end with: j1, j2 -> 1, 2; numbers stay whole."""
    if len(labels) < 2:
        return [re.sub(r"^\D+(?=\d+$)", "", label) for label in labels]
    head = re.sub(r"\d+$", "", os.path.commonprefix(labels))
    tail = re.sub(r"^\d+", "", os.path.commonprefix([label[::-1] for label in labels])[::-1])
    cut = [label[len(head) : len(label) - len(tail)] for label in labels]
    return [label.strip("_") for label in cut] if all(cut) else labels


def _stack(table: Table, columns: list[Meaning]) -> np.ndarray:
    return np.stack([table.columns[m.name] for m in columns], axis=1)


def _time(
    table: Table,
    meanings: list[Meaning],
    stacks: dict[str, np.ndarray],
    units: dict[str, tuple[str, str]],
    limits: Limits,
    speeds: Sequence[str],
    out: Proposal,
) -> Line:
    """The column that is the time: named so and increasing, else any that increases by even steps."""
    named = [m for m in meanings if m.name in table.columns and (m.quantity == "time" or set(split(m.name)) & TIME)]
    running = [m for m in named if values.increases(table.columns[m.name])]
    if not running:
        taken = {line.column for line in out.lines}
        running = [m for m in meanings if m.name in table.columns and m.name not in taken and not m.quantity]
        running = [m for m in running if values.increases(table.columns[m.name], even=True)]
        if not running:
            raise UserError("no column looks like the time", file=table.file, expected="one that increases",
                            choices=table.names)  # fmt: skip
        out.doubts.append(f"no column is called time: {running[0].name} increases by even steps")
    best = min(running, key=lambda m: ("nano" in m.name or "nsec" in split(m.name), len(split(m.name))))
    for other in running:
        if other is not best:
            out.unused[other.name] = f"{best.name} is taken for the time"
    unit, why = values.time_unit(table.columns[best.name], best.unit, stacks, units, limits, out.doubts, speeds)
    return Line("time", best.name, unit, why)


def _speeds(columns: list[Meaning]) -> tuple[str, ...]:
    """The units that speeds may be in: the one that their names state, else any."""
    stated = {m.unit for m in columns} - {""}
    return (*stated,) if len(stated) == 1 and stated <= values.STATED else values.SPEEDS


def _leftover(table: Table, meanings: list[Meaning], out: Proposal) -> None:
    """A word on every column that is not used."""
    taken = {line.column for line in out.lines}
    for m in meanings:
        if m.name in taken or m.name in out.unused:
            continue
        if m.name in table.text:
            out.unused[m.name] = "no numbers"
        elif m.quantity in OTHER:
            out.unused[m.name] = f"{OTHER[m.quantity][1]}{' used' if OTHER[m.quantity][1].endswith('not') else ''}"
        else:
            out.unused[m.name] = "its name is of no known signal"


def _sensor(names: list[str], out: Proposal) -> None:
    """What measured torque is, as far as the names say."""
    words = {word for name in names for word in split(name)}
    if all(re.search(r"tau_?J(?![a-z])", name) for name in names):
        sensor, why = "joint", "from the name (as Franka's tau_J); say motor if it comes from a current"
    elif {"load", "effort", "current", "moment"} & words:
        sensor, why = "motor", "as a load or effort mostly comes from a current; say joint for a sensor behind the gear"
    else:
        out.doubts.append(
            "torque_sensor: no name states where torque was measured; it is not used until you state joint or motor"
        )
        return
    out.recording["torque_sensor"] = sensor
    out.doubts.append(f"torque_sensor: {sensor} is guessed {why}")
