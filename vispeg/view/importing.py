"""Turn a log into a recording, in a worker process: propose a map, preview its result, write the folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vispeg.api.inputs import read_model
from vispeg.api.recording.convert import convert, placed
from vispeg.api.recording.guess import propose
from vispeg.core.errors import FLAG, UserError
from vispeg.core.files import refuse, write_text_atomic
from vispeg.formats.arrays import read_arrays
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.columns import SIGNALS
from vispeg.recordings.importers.guess.propose import Proposal
from vispeg.recordings.importers.mapping import FACTORS, map_from
from vispeg.recordings.importers.plausible import doubts
from vispeg.recordings.importers.rosbag import Topics, joint_topics
from vispeg.recordings.importers.source import is_bag, is_table, read_source
from vispeg.robots.model import load, load_for
from vispeg.sim.units import needs_of

MOST = 2000  # most samples of a preview
WHERE = {"none": "not used", "joint": "measured at the joint", "motor": "from the motor current"}


@dataclass(frozen=True)
class Proposed:
    """A proposed map, to be confirmed.

    Attributes:
        lines: (target, column, unit, reason) of each column; none for a file that names its signals as recordings do.
        units: signal -> unit, for the signals whose unit can be chosen.
        data: the map as plain data, in the form of a map file and of `vispeg convert --guess`.
        remarks: points that a person should check.
        topics: topics of joint states in a bag; the first one is read unless another is chosen.
        robot: name or file of the robot whose joints are looked up.
    """

    lines: tuple[tuple[str, str, str, str], ...]
    units: Mapping[str, str]
    data: Mapping[str, Any]
    remarks: tuple[str, ...]
    topics: tuple[str, ...] = ()
    robot: str = ""


@dataclass(frozen=True)
class Look:
    """A preview of a log read with a map: time (n,), s; signals (n, nj) in SI units; and in `doubts` impossible values.

    `rate_hz` and `samples` describe the whole log, the arrays a part of its samples.
    """

    time: np.ndarray
    joints: tuple[str, ...]
    signals: Mapping[str, np.ndarray]
    rate_hz: float
    samples: int
    doubts: tuple[str, ...]


class Importer:
    """The object of the page's worker; `tell` gets "say" (a sentence), "proposed" (Proposed) and "look" (Look)."""

    def __init__(self, tell: Callable[[str, Any], None]):
        self.tell = tell

    def propose(self, source: Path, model: str) -> None:
        """Send a proposed map, and a preview of the log read with it.

        Raises:
            UserError: the file or model does not exist, or no column can be the time or the angles.
        """
        if not source.exists():
            raise UserError("does not exist", file=source)
        self.tell("say", f"reading {source.name}")
        robot = robot_of(model)
        proposed = Proposed((), {}, {}, (), robot=robot)
        if is_table(source) and not _own_arrays(source):
            guessed = propose(source, robot)
            proposal = guessed.proposal
            lines = tuple((line.target, line.column, line.unit or "", line.why) for line in proposal.lines)
            units = {target.partition(".")[0]: unit for target, _, unit, _ in lines if unit in FACTORS}
            proposed = Proposed(lines, units, guessed.record, _remarks(proposal), robot=robot)
        elif is_bag(source):
            proposed = Proposed((), {}, {}, (), joint_topics(source), robot)
        self.tell("proposed", proposed)
        self.look(source, model, dict(proposed.data), Topics(proposed.topics[0]) if proposed.topics else None)

    def look(self, source: Path, model: str, columns: dict[str, object], topics: Topics | None = None) -> None:
        """Read the log with a map (a bag: from these topics), and send a preview."""
        robot = robot_of(model)
        arm = load(robot)
        mapping = map_from(columns, source, arm.joints)
        rec = read_source(source, placed(robot), arm.joints, mapping, limits=Limits.of(arm), topics=topics)
        every = slice(None, None, max(1, -(-len(rec.time) // MOST)))
        there = {name: getattr(rec, name)[every] for name in SIGNALS if getattr(rec, name) is not None}
        signals = {name: value for name, value in there.items() if value.ndim == 2}
        degrees = str(columns.get(f"q.{rec.joints[0]}", {})).find("deg") >= 0
        said = doubts(rec, Limits.of(arm, rec.joints), degrees, needs_of(load_for(rec.joints, robot), rec))
        lines = tuple(f"{d.key}: {d.said}" + (f" (likely {d.likely})" if d.likely else "") for d in said)
        self.tell("look", Look(rec.time[every], tuple(rec.joints), signals, rec.rate_hz, len(rec.time), lines))

    def write(
        self,
        source: Path,
        model: str,
        columns: dict[str, object],
        out: Path,
        replace: bool,
        topics: Topics | None = None,
    ) -> str:
        """Write the recording as `vispeg convert --map` would, and the map beside it; return the recording's path.

        Raises:
            UserError: one of them exists and `replace` is false, or its folder was not written by this program.
        """
        robot = robot_of(model)
        refuse(out, replace, holds="recording")
        file = map_file(out)
        if columns and file.exists() and not replace:
            raise UserError("is there already", file=file, expected="another name for the recording")
        mapping = map_from(columns, source, load(robot).joints)
        convert(source, robot, out, mapping=mapping, topics=topics, insist=True, table="parquet", overwrite=replace)
        if columns:
            text = yaml.safe_dump(columns, sort_keys=False, allow_unicode=True)
            write_text_atomic(file, text, overwrite=replace)
        return str(out)


def _own_arrays(source: Path) -> bool:
    """Return whether an NPZ file names its signals as a recording does, so that nothing must be guessed."""
    return source.suffix.lower() == ".npz" and {"time", "q"} <= set(read_arrays(source))


def robot_of(model: str) -> str:
    """Return the name or file of the robot of a model or world, in which a log's joints are looked up."""
    return str(read_model(model).robot)


def map_file(out: Path) -> Path:
    """Return the path of the map file that belongs to a recording's folder."""
    return out.with_name(f"{out.name}-map.yaml")


def _remarks(proposal: Proposal) -> tuple[str, ...]:
    """Return the points that a person should check, with the page's controls in place of command-line options."""
    signals, sensor = proposal.signals(), proposal.recording.get("torque_sensor", "none")
    # the page has fields instead of options, so of each option only the name stays
    said = (FLAG.sub(lambda flag: flag[1].replace("-", " "), doubt) for doubt in proposal.doubts)
    out = [doubt for doubt in said if not doubt.startswith("torque_sensor")]
    driven = "q_cmd" in signals or "tau_cmd" in signals
    if "tau" in signals and sensor == "none":
        more = "" if driven else "; without it nothing can be compared"
        out.append(f"No name says where torque was measured: state it in `Torque is`{more}.")
    elif "tau" in signals:
        out.append(
            f"Torque is taken as `{WHERE[sensor]}`, from its name: change it in `Torque is` where that is wrong."
        )
    servo = proposal.recording.get("control", {}).get("mode") == "servo"
    if driven and not servo:
        out.append("State the controller to compare delays, gear play, elasticity and encoder errors as well.")
    elif "tau" not in signals and not servo:
        out.append("The log has angles alone, so no model can be compared with it: log torques or commands as well.")
    return tuple(out)
