"""Schema of recording.yaml, and its validation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, field_validator

from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.formats.typed import typed
from vispeg.formats.yaml_data import read_yaml
from vispeg.recordings.columns import SIGNALS

FORMAT = "vispeg-recording/1"
MAX_JOINTS = 64

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Gain = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Vec3 = Annotated[list[Finite], Field(min_length=3, max_length=3)]


def _unit_length(quat: list[float]) -> list[float]:
    if abs(math.hypot(*quat) - 1) > 0.01:
        raise ValueError("quaternion w x y z is not of unit length")
    return quat


def _cell(value: object) -> object:
    """Accept a world's name or path in place of a mapping; `none` means no cell."""
    if not isinstance(value, str):
        return value
    return None if value == "none" else {"world": value}


Quaternion = Annotated[list[Finite], Field(min_length=4, max_length=4), AfterValidator(_unit_length)]
NoneWord = BeforeValidator(lambda value: None if value == "none" else value)
CellWord = BeforeValidator(_cell)
OneOutcome = BeforeValidator(lambda value: [value] if isinstance(value, dict) else value)


class _Section(BaseModel):
    """A mapping in recording.yaml. Keys that this version does not know are kept, to be named in a note."""

    model_config = ConfigDict(extra="allow", frozen=True)


class NullspaceSection(_Section):
    """The posture that an OSC holds in its null space: `kp` 1/s^2, `kd` 1/s, `q` rad."""

    kp: Gain
    kd: Gain
    q: list[Finite]


class ControlSection(_Section):
    """The controller that ran.

    The gains `kp` and `kd` are one per joint (N m/rad, N m s/rad), or six for `osc` (1/s^2, 1/s).
    """

    mode: Literal["torque", "position", "osc", "servo", "passive", "unknown"] = "unknown"
    rate_hz: Positive | None = None
    gravity_compensation: Literal["model", "none"] = "none"
    kp: list[Gain] | None = None
    kd: list[Gain] | None = None
    nullspace: NullspaceSection | None = None
    force_limit_n: Positive | None = None
    torque_limit_nm: list[Positive] | None = None


class ToolSection(_Section):
    """What is bolted to the flange: centre of mass, and ixx iyy izz about it."""

    mass_kg: Gain
    com_m: Vec3 = [0.0, 0.0, 0.0]
    inertia_kgm2: Annotated[list[Gain], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]
    name: str | None = None


class BaseSection(_Section):
    """How the user believes the base is mounted: roll and pitch, rad."""

    tilt_rad: Annotated[list[Annotated[float, Field(ge=-math.pi, le=math.pi)]], Field(min_length=2, max_length=2)] = [
        0.0,
        0.0,
    ]


class NoiseSection(_Section):
    """1-sigma noise, as far as it is known, in the order of the fields: rad, rad/s, N m, m, N, N m."""

    q: Positive | None = None
    dq: Positive | None = None
    tau: Positive | None = None
    ee: Positive | None = None
    ft: Positive | None = None
    ft_torque: Positive | None = None


class BoardSection(_Section):
    """A flat calibration board in the cell, as `vispeg camera calibrate` uses; `square` and `marker` are sides in m."""

    kind: Literal["chessboard", "charuco"]
    columns: int
    rows: int
    square: Positive
    marker: Gain = 0.0
    dictionary: str = ""
    legacy: bool = False


class CellSection(_Section):
    """The user's belief about the cell, in the keys of a world file."""

    world: str = ""
    task: dict[str, object] = {}
    robot: dict[str, object] | str | None = None
    effects: list[dict[str, object]] = []
    board: BoardSection | None = None


class CellOf(_Section):
    """Base of all schemas with a key `cell`."""

    cell: Annotated[CellSection | None, CellWord] = None


class WrenchSection(_Section):
    """Convention of the wrench signal `ft`: its axes, what it acts on, and the sensor's pose on the flange."""

    frame: Literal["flange", "base"] = "flange"
    acts_on: Literal["tool", "flange"] = "tool"
    tared: Literal[False, True, "weight"] = False
    pos_m: Vec3 = [0.0, 0.0, 0.0]
    quat: Quaternion = [1.0, 0.0, 0.0, 0.0]


class OutcomeSection(_Section):
    """How a trial ended."""

    success: Annotated[bool, Field(strict=True)]
    episode: int = 0
    category: str = ""
    peak_force_n: Gain | None = None
    depth_m: Finite | None = None


class SignalSection(_Section):
    """A signal of a user-defined channel: one column `NAME.JOINT` per joint."""

    unit: Annotated[str, Field(min_length=1)]
    noise: Positive | None = None


class Header(CellOf):
    """recording.yaml as a whole."""

    format: Literal["vispeg-recording/1"]
    robot: Annotated[str, Field(min_length=1)]
    joints: Annotated[list[Annotated[str, Field(min_length=1)]], Field(min_length=1, max_length=MAX_JOINTS)]
    rate_hz: Positive
    control: ControlSection = ControlSection()
    tool: Annotated[ToolSection | None, NoneWord] = None
    base: BaseSection = BaseSection()
    torque_sensor: Literal["joint", "motor", "none"] = "none"
    noise: NoiseSection = NoiseSection()
    wrench: WrenchSection | None = None
    outcome: Annotated[list[OutcomeSection], OneOutcome] = []
    signals: dict[str, SignalSection] = {}
    motion: str = ""
    notes: str = ""

    @field_validator("signals")
    @classmethod
    def _check_signals(cls, signals: dict[str, SignalSection]) -> dict[str, SignalSection]:
        for name in signals:
            if not name.isidentifier() or name in (*SIGNALS, "time", "episode"):
                raise ValueError(f"cannot name a signal of one's own: {name!r}")
        return signals

    @field_validator("joints")
    @classmethod
    def _check_joints(cls, joints: list[str]) -> list[str]:
        twice = sorted({name for name in joints if joints.count(name) > 1})
        if twice:
            raise ValueError(f"joints named twice: {', '.join(twice)}")
        odd = [name for name in joints if name != name.strip() or not name.isprintable() or set(name) & {",", '"'}]
        if odd:
            raise ValueError(f"joint name cannot head a CSV column: {odd[0]!r}")
        return joints


def read_header(file: Path) -> Header:
    """Read and validate recording.yaml; as `header_from`."""
    return header_from(read_yaml(file), file)


def header_from(data: Any, file: Path) -> Header:
    """Validate the content of recording.yaml, or an equivalent of it; note the keys that this version does not know.

    Args:
        data: the content.
        file: named in messages.

    Raises:
        UserError: not a mapping, a missing key or an invalid value.
    """
    if not isinstance(data, dict):
        raise UserError("is not a mapping", file=file, expected=f"'format: {FORMAT}' and further keys", got=data)
    header = typed(Header, data, file)
    unknown = _unknown(header)
    if unknown:
        note(f"{file}: unknown keys are ignored: {', '.join(map(str, unknown))}")
    return header


def plain(section: BaseModel) -> Mapping[str, Any]:
    """Return the stated entries of a section, without keys unknown to this version."""
    return section.model_dump(exclude_none=True, include=set(type(section).model_fields))


def _unknown(section: BaseModel, prefix: str = "") -> list[str]:
    """Return the keys of a section, and of the sections in it, that this version does not know."""
    keys = [f"{prefix}{key}" for key in section.model_extra or {}]
    for name in type(section).model_fields:
        value = getattr(section, name)
        parts = list(value.values()) if isinstance(value, dict) else value if isinstance(value, list) else [value]
        for part in parts:
            if isinstance(part, BaseModel):
                keys += _unknown(part, f"{prefix}{name}.")
    return keys
