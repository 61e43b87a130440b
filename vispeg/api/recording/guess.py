"""A map for a log whose columns have names of their own: what `vispeg convert --guess` proposes, from Python."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.importers.fits import Needs
from vispeg.recordings.importers.guess import words
from vispeg.recordings.importers.guess.constants import of_arm, stated, torque_sensor_of
from vispeg.recordings.importers.guess.propose import Proposal
from vispeg.recordings.importers.guess.source import guess
from vispeg.recordings.importers.mapping import ColumnMap, checked_rate, map_from
from vispeg.recordings.importers.source import is_table
from vispeg.recordings.recording import Recording
from vispeg.recordings.tables.read import STORES, TABLES
from vispeg.robots.model import load, load_for
from vispeg.sim.units import needs_of


@dataclass(frozen=True)
class GuessedMap:
    """A proposed map; `print` shows it as the file that `save` writes, then what more knowledge would buy.

    Attributes:
        proposal: what each column becomes, with the reasons.
        source: the table.
        joints: the robot's.
    """

    proposal: Proposal
    source: Path
    joints: tuple[str, ...]

    @property
    def text(self) -> str:
        """The map file."""
        return words.text(self.proposal)

    @property
    def record(self) -> dict[str, object]:
        """The map as plain data."""
        return words.data(self.proposal)

    @property
    def mapping(self) -> ColumnMap:
        """The map as `convert` takes it."""
        return map_from(self.record, self.source, self.joints)

    def __str__(self) -> str:
        return self.text + "\n".join(f"# {line}" for line in words.advice(self.proposal))

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the map file. Raises UserError: no .yaml name, or the file is there while `overwrite` is False."""
        path = Path(path)
        if path.suffix.lower() not in (".yaml", ".yml"):
            raise UserError("not a name for a map", key="--save-map", expected="a .yaml file", got=str(path))
        write_text_atomic(path, self.text, overwrite=overwrite)
        return path


def propose(
    source: str | Path,
    robot: str,
    torque_sensor: str | None = None,
    *,
    rate_hz: float | None = None,
    columns: Sequence[str] = (),
    calibration: Path | None = None,
    torque_constants: Sequence[str] = (),
) -> GuessedMap:
    """Give a map for a table of unknown names, with a reason for each column, tried against the robot's model.

    Args:
        source: a table, a file of arrays, or a folder of them (a LeRobot data set, episodes, signals of one run).
        robot: a name, or a path to an MJCF or URDF.
        torque_sensor: what measured torque is, in place of what is guessed.
        rate_hz: samples a second of a file that keeps no time.
        columns: names of the columns of a file without a header.
        calibration: LeRobot's calibration file.
        torque_constants: of currents, N m/A at the joint: a number a joint, JOINT=NUMBER, or the name of an arm or
            servo. Those published for the robot are used where none are stated.

    Raises:
        UserError: no table, or one in which no column can be the time or the angles; no such robot.
    """
    source = Path(source)
    if not is_table(source):
        expected = f"a table ({', '.join((*TABLES, *STORES))}); bags name their signals themselves"
        raise UserError("cannot be guessed", file=source, key="--guess", expected=expected)
    rate_hz = None if rate_hz is None else checked_rate(rate_hz, "--rate-hz")
    model = load(robot)

    def needs(rec: Recording) -> Needs | None:
        return needs_of(load_for(rec.joints, robot), rec)

    called = f"{robot} {model.name} {model.spec().modelname}"
    proposal = guess(
        source,
        model.joints,
        Limits.of(model),
        needs,
        rate_hz=rate_hz,
        names=columns,
        calibration=calibration,
        constants=stated(torque_constants, model.joints) if torque_constants else None,
        known=of_arm(called, model.joints),
    )
    sensor = torque_sensor_of(called)
    if sensor is not None and "tau" in proposal.signals() and not torque_constants and not proposal.current:
        proposal.recording["torque_sensor"] = "joint"
        proposal.doubts[:] = [doubt for doubt in proposal.doubts if not doubt.startswith("torque_sensor")]
        proposal.doubts.append(f"torque_sensor: joint, as this arm has sensors behind its gears ({sensor})")
    if torque_sensor is not None:
        proposal.recording["torque_sensor"] = torque_sensor
        proposal.doubts[:] = [doubt for doubt in proposal.doubts if not doubt.startswith("torque_sensor")]
    return GuessedMap(proposal, source, model.joints)
