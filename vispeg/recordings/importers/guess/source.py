"""Guess a map from the first rows of a table and the files beside it, and test the guess against the robot's model."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.notes import Note
from vispeg.formats.json_data import read_json
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.importers.fits import Needs, Scales, order_that_fits, scales
from vispeg.recordings.importers.guess import words
from vispeg.recordings.importers.guess.constants import KEY, Constant
from vispeg.recordings.importers.guess.motor_side import of_motors
from vispeg.recordings.importers.guess.own import own_signals
from vispeg.recordings.importers.guess.propose import Line, Proposal, labelled, propose
from vispeg.recordings.importers.guess.ticks import calibration_beside, read_calibration
from vispeg.recordings.importers.mapping import FACTORS, map_from
from vispeg.recordings.importers.plausible import doubts
from vispeg.recordings.importers.table import from_table
from vispeg.recordings.importers.turns import turned
from vispeg.recordings.recording import Recording
from vispeg.recordings.tables.read import is_text, read_table
from vispeg.recordings.tables.table import Dialect, Reading, Table
from vispeg.recordings.tables.table_csv import COMMENT, MOST_COMMENTS, opened, told_separator

ROWS = 200_000  # rows that are read: the header and the ranges of the values need no more
AGREE = 2.0  # factor by which published and fitted torque constants may differ; errors of masses and friction are less
BEYOND = 5.0  # if readings taken as amperes give more than this multiple of the torque limit, they are milliamperes
QUESTION = (
    f"their torque constants, N m/A at the joint (motor constant x gear), would give torques without the use of the "
    f"model's masses: {KEY} with a number a joint, JOINT=NUMBER, or the name of an arm or servo (ur5e, XM430-W350)"
)
INFO = "meta/info.json"  # of a LeRobot data set, up to four folders above its tables

NeedsOf = Callable[[Recording], Needs | None]  # the robot's torques for the joints of a recording
LINES = 20  # lines of a text table from which its dialect is detected
DECIMAL_COMMA = re.compile(r"(?<![\d.])-?\d+,\d+(?![\d,])")


def guess(
    source: Path,
    joints: Sequence[str],
    limits: Limits,
    needs_of: NeedsOf = lambda rec: None,
    *,
    rate_hz: float | None = None,
    names: Sequence[str] = (),
    calibration: Path | None = None,
    constants: Mapping[str, Constant] | None = None,
    known: Mapping[str, Constant] | None = None,
) -> Proposal:
    """Propose a map for a table with unknown column names; contradictions with numbers or model become its doubts.

    Args:
        source: a file that `read_table` reads.
        joints: the robot's joints.
        limits: limits of these joints.
        needs_of: returns the model's inverse dynamics; tests an unstated joint order and the scale of torques.
        rate_hz: samples per second, for a file without time stamps.
        names: column names, for a text table or array without a header.
        calibration: LeRobot's calibration file; by default the one beside the data set.
        constants: joint -> torque constant stated by the user; measured torque is then a current.
        known: joint -> torque constant published for the robot, used if measured torque is a current.

    Raises:
        UserError: not a table, or no column can be the time or the angles.
    """
    dialect = dialect_of(source, tuple(names)) if is_text(source) and source.is_file() else Dialect(names=tuple(names))
    table = read_table(source, Reading(most_rows=ROWS, dialect=dialect))
    if all(name.isdigit() for name in table.names):
        expected = f"--columns with {len(table.names)} names, such as time,q1,q2"
        raise UserError("the first line holds numbers", file=source, expected=expected)
    file = calibration or calibration_beside(source)
    ranges = None if file is None else read_calibration(file)

    labels = labelled(table, _lerobot(source))

    def proposed(order: Sequence[int] | None = None) -> Proposal:
        return propose(table, joints, limits, dialect, labels, order=order, rate_hz=rate_hz, calibration=ranges)

    torque_limits = dict(zip(joints, limits.torque.tolist(), strict=True))
    out = proposed()
    if constants and "tau" not in out.signals():
        raise UserError("no column looks like a current", file=source, key=KEY, got=", ".join(constants))
    of_motors(out, table, joints, limits, needs_of)
    rec = _tried(out, table, source, joints, limits)
    needs = None if rec is None else needs_of(rec)
    if rec is None or needs is None:
        if not _by_constants(out, rec, None, constants, known, torque_limits):
            _without_current(out)
    else:
        if out.assumed and rec.tau is not None and not out.current:
            better = order_that_fits(rec, needs)
            if better is not None:
                out = proposed(better.order)
                mended = _tried(out, table, source, joints, limits)
                which = ", ".join(line.column for line in out.lines if line.target.startswith("q."))
                out.doubts.append(
                    f"another order than the file's fits the model: measured and modelled torque differ by "
                    f"{better.best:.3g} N m RMS instead of {better.given:.3g}; it is proposed: {which}"
                )
                rec = rec if mended is None else mended
        found = None if rec.tau is None else scales(rec, needs)
        if not _by_constants(out, rec, found, constants, known, torque_limits):
            _scaled(out, found)
    own_signals(out, table, joints, labels)
    return out


def _tried(out: Proposal, table: Table, source: Path, joints: Sequence[str], limits: Limits) -> Recording | None:
    """Build the recording that a proposal describes; what is implausible in it becomes a doubt of the proposal."""
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            data = words.data(out)
            # stated, so that no note says that torques are not used: the proposal itself asks for the sensor
            data["recording"] = {"torque_sensor": "motor", **out.recording}
            rec = from_table(table, source, "robot", joints, map_from(data, source, joints))
            order = [list(joints).index(joint) for joint in rec.joints]
            chosen = Limits(limits.range[order], limits.velocity[order], limits.torque[order])
            rec = turned(rec, chosen, source)
    except UserError as error:
        out.doubts.append(str(error).removeprefix(f"{source}: "))
        return None
    out.doubts += [str(w.message).removeprefix(f"{source}: ") for w in said if issubclass(w.category, Note)]
    degrees = any(line.unit == "deg" for line in out.lines if line.target.startswith("q."))
    judged = replace(rec, tau=None) if out.current else rec
    out.doubts += [doubt.line for doubt in doubts(judged, chosen, degrees)]
    return rec


def _by_constants(
    out: Proposal,
    rec: Recording | None,
    found: Scales | None,
    stated: Mapping[str, Constant] | None,
    known: Mapping[str, Constant] | None,
    torque_limits: Mapping[str, float],
) -> bool:
    """Convert currents to torques by torque constants; False if no constant is known or the readings are not currents.

    For a column that is not named a current, published constants are used only if the fitted scale agrees with them.
    """
    constants = stated or known or {}
    if rec is None or rec.tau is None or not set(constants) & set(rec.joints):
        return False
    joints = [joint for joint in rec.joints if joint in constants]
    places = [rec.joints.index(joint) for joint in joints]
    values = np.array([constants[joint].value for joint in joints])  # N m/A
    # N m per unit of the readings, which is A or mA
    fitted = np.full(len(joints), np.nan) if found is None or not found.told else 1.0 / found.scale[places]
    ratio = float(np.nanmedian(np.abs(fitted) / values)) if np.isfinite(fitted).any() else math.nan
    unit = min(("A", "mA"), key=lambda u: abs(math.log(ratio / FACTORS[u]))) if ratio > 0 else ""
    agree = bool(unit) and 1 / AGREE < ratio / FACTORS[unit] < AGREE
    named = out.current or bool(stated)
    if not (named or (agree and found is not None and found.foreign)):
        return False
    if out.ampere:
        unit, why = out.ampere, f"the name says {out.ampere}"
    elif agree:
        why = f"in {unit} the model's torques agree"
    else:
        share = np.nanmax(np.abs(rec.tau[:, places]) * values, axis=0) / [torque_limits[joint] for joint in joints]
        unit = "mA" if np.isfinite(share).any() and np.nanmax(share) > BEYOND else "A"
        why = f"{unit} is taken"
        out.doubts.append(f"currents: no name states their unit, and this motion does not tell it: {unit} is taken")
    torques = [line for line in out.lines if line.target.startswith("tau.") and line.named]
    if torques and not out.current:
        raise UserError("the name says that it is no current", file=out.file, key=KEY, got=torques[0].column)
    lines = []
    for line in out.lines:
        signal, _, joint = line.target.partition(".")
        if signal == "tau" and joint not in constants:
            out.unused[line.column] = f"{joint}: its torque constant is not known"
            line = Line(line.target, "", "", "measured torque: its torque constant is not known", "measured")
        elif signal == "tau":
            k = constants[joint]
            sign = -1.0 if fitted[joints.index(joint)] < 0 else 1.0
            said = f"{line.why}; {why}; {k.value:g} N m/A: {k.source}"
            line = replace(line, unit=unit, scale=sign, constant=k.value, why=said, sure="stated")
        lines.append(line)
    out.lines = lines
    out.set_sensor("motor")
    if not stated:
        out.doubts.append(f"torque constants as published for this arm; {KEY} states those of your own")
    if found is not None and np.isfinite(fitted).any():
        compared = [
            f"{joint} {constant / FACTORS[unit]:.3g} +- {sigma / scale**2 / FACTORS[unit]:.1g} for {value:.4g}"
            for joint, constant, value, sigma, scale in zip(
                joints, fitted, values, found.sigma[places], found.scale[places], strict=True
            )
            if np.isfinite(constant)
        ]
        odd = "" if 1 / AGREE < ratio / FACTORS[unit] < AGREE else ": they do not agree, look at unit and constants"
        out.doubts.append(f"N m/A by this motion and the model's masses: {', '.join(compared)}{odd}")
    return True


def _scaled(out: Proposal, found: Scales | None) -> None:
    """Scale torques that are not in N m to the model's torques, and drop joints whose readings carry no information."""
    if found is None or not (found.foreign or (out.current and found.told)):
        if out.current:
            _without_current(out)
        return
    out.doubts.append(found.line)
    if any(line.named for line in out.lines if line.target.startswith("tau.")):
        return
    known = np.abs(found.scale[np.isfinite(found.scale)])
    usual = float(np.median(known))
    lines = []
    for line in out.lines:
        signal, _, joint = line.target.partition(".")
        if signal != "tau":
            lines.append(line)
            continue
        j = found.joints.index(joint)
        if not np.isfinite(found.scale[j]):
            why = (
                "carries no information" if found.silent[j] else f"its scale is not known (the others' is {usual:.2g})"
            )
            out.unused[line.column] = f"{joint}: {why}"
            lines.append(Line(line.target, "", "", f"measured torque: {why}", "measured"))
            continue
        s, sigma = float(found.scale[j]), float(found.sigma[j])
        why = f"in proportion to the model's torque by {s:.3g} +- {sigma:.1g} a N m, {found.explained[j]:.0%} explained"
        lines.append(replace(line, unit="N m", scale=float(f"{1 / s:.4g}"), why=f"{line.why}; {why}", sure="measured"))
    out.lines = lines
    out.set_sensor("motor", "motor, as a current is; its scale can be fitted beside friction (torque_gain)")
    out.doubts.append(f"currents: {QUESTION}")


def _without_current(out: Proposal) -> None:
    """Remove currents from the proposal whose scale cannot be determined."""
    if out.current:
        why = "a current, whose scale this motion does not tell: no torque"
        out.unused |= {line.column: why for line in out.lines if line.target.startswith("tau.")}
        out.lines = [line for line in out.lines if not line.target.startswith("tau.")]
        out.set_sensor(None)
        out.doubts.append(f"currents: {QUESTION}")
        out.current = False


def _lerobot(source: Path) -> dict[str, str]:
    """Return column -> joint, such as `observation.state[0]` -> the name in the LeRobot data set's meta/info.json."""
    for folder in [source.resolve(), *source.resolve().parents[:4]]:
        if (folder / INFO).is_file():
            try:
                features = read_json(folder / INFO)["features"]
                return {label: name for key in features for label, name in _named(key, features[key])}
            except (UserError, KeyError, TypeError, AttributeError):
                return {}  # written by another program, or damaged: only the header is used
    return {}


def _named(key: str, feature: Any) -> list[tuple[str, str]]:
    names = feature.get("names")
    if isinstance(names, dict):
        names = next((value for value in names.values() if isinstance(value, list)), None)
    if feature.get("dtype") not in ("float32", "float64") or not isinstance(names, list):
        return []
    return [(f"{key}[{i}]", str(name).removesuffix(".pos")) for i, name in enumerate(names)]


def dialect_of(file: Path, names: tuple[str, ...]) -> Dialect:
    """Detect the dialect of a text table: cell separator and decimal mark.

    Args:
        file: the table.
        names: column names, for a table without a header line.

    Raises:
        UserError: not text.
    """
    try:
        with opened(file) as stream:
            lines, comments, told, first = [], 0, "", True
            while len(lines) < LINES and (raw := stream.readline(1 << 20)):
                line = raw.decode().rstrip("\r\n")
                if first and (told := told_separator(line)):
                    continue
                comment = not lines and line.lstrip()[:1] in COMMENT  # an empty line counts as one
                comments += comment
                if line.strip() and not comment:
                    lines.append(line)
                first = False
                if comments > MOST_COMMENTS:
                    break
    except OSError as error:
        raise UserError(f"cannot be read: {error.strerror or error}", file=file) from error
    if not lines:
        raise UserError("is empty", file=file)
    head, body = lines[0], lines[1:] or lines
    separator = told or max((";", "\t", ","), key=head.count)
    if not told and not head.count(separator):
        cells = len(head.split())
        separator = " " if cells > 1 and all(len(line.split()) == cells for line in body) else ","
    comma = separator != "," and any(DECIMAL_COMMA.search(cell) for line in body for cell in line.split(separator))
    return Dialect(separator, "," if comma else ".", names)
