"""A log becomes a recording, in a worker process: a proposal, a look at what it means, the folder."""

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

MOST = 2000  # samples of the look
WHERE = {"none": "not used", "joint": "measured at the joint", "motor": "from the motor current"}


@dataclass(frozen=True)
class Proposed:
    """A map to be confirmed.

    Attributes:
        lines: (target, column, unit, reason) of each column; none for a file that names its signals itself.
        units: signal -> its unit, of those whose unit can be chosen.
        data: the map as plain data, as a map file holds it and `vispeg convert --guess` proposes it.
        remarks: what a person should look at.
        topics: of joint states in a bag; the first one is read unless another is chosen.
        robot: the name or file that the joints are looked up in.
    """

    lines: tuple[tuple[str, str, str, str], ...]
    units: Mapping[str, str]
    data: Mapping[str, Any]
    remarks: tuple[str, ...]
    topics: tuple[str, ...] = ()
    robot: str = ""


@dataclass(frozen=True)
class Look:
    """What a map makes of a log: time (n,) s, signals (n, nj) in SI units, and what cannot be true of them."""

    time: np.ndarray
    joints: tuple[str, ...]
    signals: Mapping[str, np.ndarray]
    rate_hz: float
    samples: int
    doubts: tuple[str, ...]


class Importer:
    """What the page's worker holds; `tell` is called with "say" (a sentence), "proposed" (Proposed), "look" (Look)."""

    def __init__(self, tell: Callable[[str, Any], None]):
        self.tell = tell

    def propose(self, source: Path, model: str) -> None:
        """Proposes a map, and looks at what it makes of the log.

        Raises:
            UserError: no such file or model, or no column that can be the time or the angles.
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
        """Read the log with a map, and of a bag the topics, and tell what comes out."""
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
            UserError: either is there already and not to be replaced, or holds what this program did not write.
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
    """Whether an archive names its signals as a recording does, so that nothing is to be guessed."""
    return source.suffix.lower() == ".npz" and {"time", "q"} <= set(read_arrays(source))


def robot_of(model: str) -> str:
    """Give the robot of a model, a world or a robot: the name or file that a log's joints are looked up in."""
    return str(read_model(model).robot)


def map_file(out: Path) -> Path:
    """Where the map of a recording's folder is kept."""
    return out.with_name(f"{out.name}-map.yaml")


def _remarks(proposal: Proposal) -> tuple[str, ...]:
    """Give what a person should look at, with the page's own controls for what to do."""
    signals, sensor = proposal.signals(), proposal.recording.get("torque_sensor", "none")
    # a page has fields, no options: what one is called stays
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
