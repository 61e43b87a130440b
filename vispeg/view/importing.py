"""Turn a log into a recording, in the page's worker process: propose a map, preview its result, write the folder."""

from __future__ import annotations

import math
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

MOST = 2000  # greatest number of samples of a preview
SENSOR_WORDS = {  # value of torque_sensor -> words of the page
    "none": "not used",
    "joint": "measured at the joint",
    "motor": "from the motor current",
}


@dataclass(frozen=True)
class Proposed:
    """A proposed map, to be confirmed by the user.

    Bags, and files that name their signals as recordings do, need no map: all but `topics` and `robot` is empty.

    Attributes:
        lines: column of the recording, column of the log, unit ("" for none) and reason, for each proposed column.
        units: signal -> unit of its column, for signals whose unit the page lets one choose.
        data: the map as plain data, in the form of a map file.
        remarks: points that the user should check, one sentence each.
        topics: topics of joint states in a bag; the first one is read unless another is chosen.
        robot: name or file of the robot whose joint names are looked for in the log.
    """

    lines: tuple[tuple[str, str, str, str], ...]
    units: Mapping[str, str]
    data: Mapping[str, Any]
    remarks: tuple[str, ...]
    topics: tuple[str, ...] = ()
    robot: str = ""


@dataclass(frozen=True)
class Look:
    """A preview of a log read with a map.

    Attributes:
        time: (n,) s, of every k-th sample, so that n is at most MOST.
        joints: names of the nj joints.
        signals: name -> values at these samples in SI units: (n, nj) of joints, (n, 7) of poses, (n, 6) of wrenches.
        rate_hz: sample rate of the whole log.
        samples: number of samples of the whole log.
        doubts: what is implausible about units and values, one sentence each.
    """

    time: np.ndarray
    joints: tuple[str, ...]
    signals: Mapping[str, np.ndarray]
    rate_hz: float
    samples: int
    doubts: tuple[str, ...]


class Importer:
    """The object in the page's worker process that reads and converts logs.

    Args:
        tell: called with a kind and its content: "say", a sentence; "proposed", a Proposed; "look", a Look.
    """

    def __init__(self, tell: Callable[[str, Any], None]):
        self.tell = tell

    def propose(self, source: Path, model: str) -> None:
        """Send a proposed map, and a preview of the log read with it.

        Args:
            source: the log.
            model: model or world whose robot made the log.

        Raises:
            UserError: log or model does not exist or cannot be read, or no column can be the time or the angles.
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
        """Send a preview of the log `source`, read with the map `columns`, or from `topics` if it is a bag."""
        robot = robot_of(model)
        arm = load(robot)
        mapping = map_from(columns, source, arm.joints)
        rec = read_source(source, placed(robot), arm.joints, mapping, limits=Limits.of(arm), topics=topics)
        shown = slice(None, None, max(1, math.ceil(len(rec.time) / MOST)))
        recorded = {name: getattr(rec, name)[shown] for name in SIGNALS if getattr(rec, name) is not None}
        signals = {name: value for name, value in recorded.items() if value.ndim == 2}
        found = doubts(rec, Limits.of(arm, rec.joints), mapping.in_degrees, needs_of(load_for(rec.joints, robot), rec))
        lines = tuple(f"{d.key}: {d.said}" + (f" (likely {d.likely})" if d.likely else "") for d in found)
        self.tell("look", Look(rec.time[shown], tuple(rec.joints), signals, rec.rate_hz, len(rec.time), lines))

    def write(
        self,
        source: Path,
        model: str,
        columns: dict[str, object],
        out: Path,
        replace: bool,
        topics: Topics | None = None,
    ) -> str:
        """Write the recording as `vispeg convert --map` would, and beside it the map if there is one.

        Args:
            source: the log.
            model: model or world whose robot made the log.
            columns: the map as plain data; empty for none.
            out: folder of the recording.
            replace: whether to replace a recording and a map that exist.
            topics: topics to read from a bag.

        Returns:
            The recording's path.

        Raises:
            UserError: the log cannot be converted, recording or map exist and `replace` is false, or `out` is a folder
                that this program did not write.
        """
        robot = robot_of(model)
        refuse(out, replace, holds="recording")
        file = map_file(out)
        if columns and file.exists() and not replace:
            raise UserError("exists already", file=file, expected="another name for the recording")
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
    """Return the points that the user should check, in which the page's fields replace command-line options."""
    signals, sensor = proposal.signals(), proposal.recording.get("torque_sensor", "none")
    # options become the names of fields: `--torque-sensor` becomes `torque sensor`
    out = [FLAG.sub(lambda flag: flag[1].replace("-", " "), doubt) for doubt in proposal.doubts]
    driven = "q_cmd" in signals or "tau_cmd" in signals
    if "tau" in signals and sensor == "none":
        more = "" if driven else "; without it nothing can be compared"
        out.append(f"No name says where torque was measured: state it in `Torque is`{more}.")
    elif "tau" in signals:
        out.append(
            f"Torque is taken as `{SENSOR_WORDS[sensor]}`, from its name: change it in `Torque is` where that is wrong."
        )
    servo = proposal.recording.get("control", {}).get("mode") == "servo"
    if driven and not servo:
        out.append("State the controller to compare delays, gear play, elasticity and encoder errors as well.")
    elif "tau" not in signals and not servo:
        out.append("The log has angles alone, so no model can be compared with it: log torques or commands as well.")
    return tuple(out)
