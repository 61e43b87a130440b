"""Propose a map for a log with unknown column names, as `vispeg convert --guess` does."""

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
from vispeg.recordings.importers.source import is_table, refuse_recording
from vispeg.recordings.recording import Recording
from vispeg.recordings.tables.read import STORES, TABLES
from vispeg.robots.model import load, load_for
from vispeg.sim.units import needs_of


@dataclass(frozen=True)
class GuessedMap:
    """A proposed map; `print` shows the map file, and what more information would make possible.

    Attributes:
        proposal: the meaning of each column, with reasons.
        source: the log.
        joints: names of the robot's joints.
    """

    proposal: Proposal
    source: Path
    joints: tuple[str, ...]

    @property
    def text(self) -> str:
        """Content of the map file."""
        return words.text(self.proposal)

    @property
    def record(self) -> dict[str, object]:
        """The map as plain data."""
        return words.data(self.proposal)

    @property
    def mapping(self) -> ColumnMap:
        """The map in the form that `convert` accepts."""
        return map_from(self.record, self.source, self.joints)

    def __str__(self) -> str:
        return self.text + "\n".join(f"# {line}" for line in words.advice(self.proposal))

    def _repr_html_(self) -> str:
        return f"<pre>{escape(str(self))}</pre>"

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the map file. Raises UserError: not a .yaml name, or the file exists and `overwrite` is False."""
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
    """Propose a map for a log with unknown column names, with reasons, checked against the robot's model.

    Args:
        source: a table, a file of arrays, or a folder of them (a LeRobot data set, episodes, signals of one run).
        robot: a robot's name, or a path to an MJCF or URDF.
        torque_sensor: where torque was measured, in place of the guess.
        rate_hz: sample rate of a file without time stamps, Hz.
        columns: names of the columns of a file without a header line.
        calibration: LeRobot's calibration file.
        torque_constants: torque constants for currents, N m/A at the joint: one number per joint, JOINT=NUMBER, or the
            name of an arm or servo; by default those published for the robot.

    Raises:
        UserError: not a table, or a recording; no column can be the time or the angles, or no such robot.
    """
    source = Path(source)
    refuse_recording(source)
    if not is_table(source):
        expected = f"a table ({', '.join((*TABLES, *STORES))}); bags name their signals themselves"
        raise UserError("cannot be guessed", file=source, key="--guess", expected=expected)
    rate_hz = None if rate_hz is None else checked_rate(rate_hz, "--rate-hz")
    model = load(robot)

    def needs(rec: Recording) -> Needs | None:
        return needs_of(load_for(rec.joints, robot), rec)

    robot_names = f"{robot} {model.name} {model.spec().modelname}"
    proposal = guess(
        source,
        model.joints,
        Limits.of(model),
        needs,
        rate_hz=rate_hz,
        names=columns,
        calibration=calibration,
        constants=stated(torque_constants, model.joints) if torque_constants else None,
        known=of_arm(robot_names, model.joints),
    )
    sensor = torque_sensor_of(robot_names)
    if sensor is not None and "tau" in proposal.signals() and not torque_constants and not proposal.current:
        proposal.set_sensor("joint", f"joint, as this arm has sensors behind its gears ({sensor})")
    if torque_sensor is not None:
        proposal.set_sensor(torque_sensor)
    return GuessedMap(proposal, source, model.joints)
