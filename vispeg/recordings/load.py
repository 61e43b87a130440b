"""Load a recording folder (docs/formats.md), refusing content that would mislead a fit."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.core.paths import expanded
from vispeg.formats.format import enrol
from vispeg.recordings.cell import CellBelief, Outcome, WrenchSensor
from vispeg.recordings.columns import JOINT_SIGNALS, NEEDED, SIGNALS, SPATIAL_SIGNALS, columns_of
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.frames.files import read_frames
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.recordings.load_cell import cell, outcomes, wrench
from vispeg.recordings.recording import Control, Nullspace, Recording, Signal
from vispeg.recordings.schema import ControlSection, Header, SignalSection, plain, read_header
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.tables.table import Reading, Table
from vispeg.recordings.validate import check_angles, check_episodes, check_finite, check_share, check_time, check_unit

HEADER, SAMPLES = "recording.yaml", ("samples.csv", "samples.parquet")


def _example(folder: Path) -> Path:
    from vispeg.recordings.write import write

    time = np.arange(20) / 100.0
    q = np.column_stack([0.1 * np.sin(time), 0.2 * np.cos(time)])
    ee = np.tile([0.5, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0], (20, 1))
    further = {"tool": {"mass_kg": 0.3}, "noise": {"q": 1e-4}, "torque_sensor": "joint"}
    further["episode"] = np.repeat([0, 1], 10)
    control = Control("position", 100.0, "model", np.full(2, 100.0), np.full(2, 10.0))
    eye = RecordedCamera("eye", 8, 6, 9.0, 9.0, 3.5, 2.5, mount="flange", pose=np.eye(4))
    picture = np.arange(48, dtype=np.uint8).reshape(6, 8)
    frame = RecordedFrame(0.05, eye, np.stack([picture] * 3, -1), picture / np.float32(100))
    further["frames"] = Frames({"eye": eye}, (frame,))
    further |= {
        "ft": np.ones((20, 6)),
        "wrench": WrenchSensor(tared="weight"),
        "outcomes": (Outcome(True, 1, "success", 9.0),),
    }
    further["signals"] = {"current": Signal(q + 1.0, "A", 0.02)}
    effects = ({"effect": "contact_friction", "where": "fixture"},)
    further["cell"] = CellBelief("nominal", {"friction": 0.2}, None, effects)
    rec = Recording(folder / "rig", "iiwa14", ("a", "b"), 100.0, control, time, q, tau=q, q_cmd=q, ee=ee, **further)
    return write(rec, folder / "rig")


@enrol("vispeg-recording/1", _example)
def load(
    path: Path | str,
    signals: Callable[[Header], Collection[str]] | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Recording:
    """Load the recording in a folder with recording.yaml, samples.csv or samples.parquet, and optionally frames/.

    Values are kept unchanged: no resampling, no normalisation, NaN for empty cells. Unknown keys are ignored with one
    warning that lists them, and so are unknown columns.

    Args:
        path: the folder.
        signals: maps the header to the signals of `SIGNALS` to keep in addition to `q`, such as `needed`;
            the others are only checked, and None in the recording. None keeps all.
        progress: called with the share that has been read, 0 to 1.

    Returns:
        The recording in SI units and radians, with an absolute path if `robot` is a path.

    Raises:
        UserError: anything missing, malformed or implausible; the error names the file and the key, column or row.
    """
    folder = expanded(path)
    if not folder.name or folder.name == "..":
        folder = folder.resolve()
    header_file, samples_file = _files(folder)
    header = read_header(header_file)
    keep = None if signals is None else signals(header)
    table = read_table(samples_file, _reading(header, keep, progress))
    rec = assemble(header, table, folder, header_file, keep)
    frames = read_frames(folder, rec.time, rec.episode)
    _warn_unknown(table, header)  # last, so that an error stands alone
    return rec if frames is None else replace(rec, frames=frames)


def needed(header: Header) -> tuple[str, ...]:
    """Return the signals to compare for a recording with this header: commands, and torque and wrench if described."""
    torque = ("tau",) if header.torque_sensor != "none" else ()
    rates = {"position": ("dq_cmd",), "osc": ("dq",), "servo": ("load",)}.get(header.control.mode, ())
    wrench = ("ft",) if header.wrench is not None else ()
    return (*NEEDED[header.control.mode], *rates, *torque, *wrench)


def _reading(header: Header, keep: Collection[str] | None, progress: Callable[[float], None]) -> Reading:
    """Return which columns to read; those of signals that are not kept are only checked, block by block."""
    joints = header.joints
    retained = (*(s for s in SIGNALS if keep is None or s == "q" or s in keep), *header.signals)
    passing = tuple(s for s in SIGNALS if s not in retained)

    def look(block: Table) -> None:
        for name in passing:
            columns = columns_of(name, joints)
            if all(column in block.columns for column in columns):
                _check(block, name, np.stack([block.columns[column] for column in columns], axis=1), columns)

    return Reading(
        keep=lambda _: ["time", "episode", *(c for s in retained for c in columns_of(s, joints))],
        glance=lambda _: [c for s in passing for c in columns_of(s, joints)],
        look=look if passing else None,
        progress=progress,
    )


def assemble(
    header: Header, table: Table, folder: Path, header_file: Path, keep: Collection[str] | None = None
) -> Recording:
    """Build a validated recording from a header and a table of any origin.

    Args:
        header: content of recording.yaml.
        table: the samples; columns that belong to no signal of the header's joints are left out.
        folder: names the recording, and is the base of a relative `robot` path.
        header_file: the file that errors about the header name.
        keep: signals to keep in addition to `q`; None keeps all.

    Raises:
        UserError: as for `load`.
    """
    control = _control(header.control, header.rate_hz, len(header.joints), header_file)
    retained = {*SIGNALS} if keep is None else {"q", *keep}
    signals = {name: _signal(table, name, header.joints, name in retained) for name in SIGNALS}
    _need(table, header, signals)
    time, episode = _clock(table, header.rate_hz)
    q = signals.pop("q")
    if q is None:  # cannot happen after `_need`; narrows the type
        raise UserError("has no measured angles", file=table.file, expected=columns_of("q", header.joints)[0])
    return Recording(
        path=folder,
        robot=_robot(header.robot, folder, header_file),
        joints=tuple(header.joints),
        rate_hz=header.rate_hz,
        control=control,
        time=time,
        q=q,
        **signals,  # type: ignore[arg-type]  # its keys are SIGNALS without `q`, all arrays
        signals={name: _declared(table, name, section, header) for name, section in header.signals.items()},
        episode=episode,
        tool=None if header.tool is None else plain(header.tool),
        base_tilt=(header.base.tilt_rad[0], header.base.tilt_rad[1]),
        torque_sensor=header.torque_sensor,
        noise=plain(header.noise),
        cell=cell(header.cell, header_file),
        wrench=wrench(header.wrench),
        outcomes=outcomes(header.outcome, episode, header_file),
        motion=header.motion,
        notes=header.notes,
    )


def _files(folder: Path) -> tuple[Path, Path]:
    """Return a recording's header and its table of samples. Raises UserError: the folder does not hold one of each."""
    try:
        if not folder.exists():
            raise UserError("does not exist", file=folder, expected="a recording folder")
        if not folder.is_dir():
            raise UserError("is a file", file=folder, expected=f"the folder that holds {HEADER}")
        tables = [folder / name for name in SAMPLES if (folder / name).is_file()]
        header = folder / HEADER
        if not header.is_file():
            raise UserError(f"holds no {HEADER}", file=folder)
    except (OSError, ValueError) as error:  # a name too long, a NUL in it, no permission
        raise UserError(f"cannot be read: {error}", file=folder) from error
    if len(tables) != 1:
        raise UserError(
            f"holds both {' and '.join(SAMPLES)}" if tables else "holds no samples",
            file=folder,
            expected=f"one of {', '.join(SAMPLES)}",
        )
    return header, tables[0]


def _robot(robot: str, folder: Path, file: Path) -> str:
    """Return a robot's name unchanged, and a path (it has a suffix or a slash) as an absolute path."""
    if "/" not in robot and not robot.lower().endswith((".xml", ".urdf", ".mjcf")):
        return robot
    try:
        path = (folder / expanded(robot, file, "robot")).resolve()
        exists = path.is_file()
    except (OSError, ValueError, RuntimeError) as error:
        raise UserError("is not a usable path", file=file, key="robot", got=robot) from error
    if not exists:
        raise UserError("no such file", file=file, key="robot", expected="an MJCF or URDF beside this file", got=robot)
    return str(path)


def _control(section: ControlSection, rate_hz: float, nj: int, file: Path) -> Control:
    """Check the number of gains against the mode: one per joint for position, six for osc."""
    size = {"position": nj, "osc": 6}.get(section.mode)
    gains: dict[str, np.ndarray | None] = {}
    for name in ("kp", "kd"):
        value = getattr(section, name)
        if value is None and size is not None:
            raise UserError("is missing", file=file, key=f"control.{name}", expected=f"{size} numbers")
        if value is not None and size is not None and len(value) != size:
            raise UserError("has the wrong length", file=file, key=f"control.{name}", expected=size, got=len(value))
        gains[name] = None if value is None else np.array(value, float)
    null = section.nullspace
    if null is not None and len(null.q) != nj:
        raise UserError("has the wrong length", file=file, key="control.nullspace.q", expected=nj, got=len(null.q))
    return Control(
        mode=section.mode,
        rate_hz=section.rate_hz or rate_hz,
        gravity_compensation=section.gravity_compensation,
        nullspace=None if null is None else Nullspace(null.kp, null.kd, np.array(null.q, float)),
        force_limit=section.force_limit_n,
        torque_limit=_torque_limit(section.torque_limit_nm, nj, file),
        **gains,
    )


def _torque_limit(limit: list[float] | None, nj: int, file: Path) -> np.ndarray | None:
    if limit is not None and len(limit) != nj:
        raise UserError("has the wrong length", file=file, key="control.torque_limit_nm", expected=nj, got=len(limit))
    return None if limit is None else np.array(limit, float)


def _declared(table: Table, name: str, section: SignalSection, header: Header) -> Signal:
    """Read a signal that the header declares. Raises UserError: a column is absent."""
    values = _signal(table, name, header.joints, True)
    if values is None:
        expected = columns_of(name, header.joints)[0]
        raise UserError(
            f"has no column of the signal {name}, which its header declares", file=table.file, expected=expected
        )
    return Signal(values, section.unit, section.noise)


def _signal(table: Table, name: str, joints: list[str], keep: bool) -> np.ndarray | None:
    """Read one signal (n, width); None if it is not kept or has no columns. With some columns, it must have all.

    Columns are removed from the table as they become a signal, so that memory does not hold a long recording twice.
    """
    columns = columns_of(name, joints)
    if name != "q" and not any(column in table.names for column in columns):
        return None
    for column in columns:
        if column in table.text or column not in table.names:
            table.number(column)  # raises UserError
    if not keep:
        return None
    values = np.empty((table.rows, len(columns)))
    for j, column in enumerate(columns):
        values[:, j] = table.columns.pop(column)
    _check(table, name, values, columns)
    return values


def _check(table: Table, name: str, values: np.ndarray, columns: list[str]) -> None:
    check_finite(table, values, columns)
    if name in ("q", "q_cmd"):
        check_angles(table, values, columns)
    if name in ("ee", "ee_cmd"):
        check_unit(table, values[:, 3:], name)


def _need(table: Table, header: Header, signals: dict[str, np.ndarray | None]) -> None:
    """Raise UserError if a signal that the control mode needs is absent or misses too many readings."""
    mode = header.control.mode
    contact = ("ft",) if (header.wrench is not None or header.cell is not None) and signals["ft"] is not None else ()
    for name in ("q", *NEEDED[mode], *contact):
        values = signals[name]
        columns = columns_of(name, header.joints)
        if columns[0] not in table.names:
            raise UserError(f"control mode '{mode}' needs {columns[0]} ... {columns[-1]}", file=table.file)
        if values is not None:
            check_share(table, values, columns)
    if columns_of("tau", header.joints)[0] in table.names and header.torque_sensor == "none":
        unused = "has tau columns, but `torque_sensor` is none: no comparison or fit uses them; say joint or motor"
        note(f"{table.file}: {unused}")


def _clock(table: Table, rate_hz: float) -> tuple[np.ndarray, np.ndarray | None]:
    time = table.number("time")
    episode = None
    if "episode" in table.names:
        episode = check_episodes(table, table.number("episode"))
    check_time(table, time, episode, rate_hz)
    return time, episode


def _warn_unknown(table: Table, header: Header) -> None:
    expected = {
        "time",
        "episode",
        *(c for s in (*JOINT_SIGNALS, *SPATIAL_SIGNALS, *header.signals) for c in columns_of(s, header.joints)),
    }
    unknown = [name for name in table.names if name not in expected]
    if unknown:
        listing = ", ".join(unknown[:8]) + (f" and {len(unknown) - 8} more" if len(unknown) > 8 else "")
        note(f"{table.file}: unknown columns are ignored: {listing}")
