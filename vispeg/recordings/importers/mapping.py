"""Map files: how a log's own names and units translate to those of a recording."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.formats.format import enrol
from vispeg.formats.yaml_data import read_yaml
from vispeg.recordings.columns import SIGNALS, columns_of
from vispeg.recordings.tables.table import Dialect

TICK = 2 * math.pi / 4096  # rad, encoder tick of Feetech's STS3215 and Dynamixel's X series
QUANTITIES: tuple[dict[str, float], ...] = (  # for each physical quantity: unit -> factor to SI
    {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "mdeg": math.pi / 180e3, "turn": 2 * math.pi, "tick": TICK},
    {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": math.pi / 30},
    {"A": 1.0, "mA": 1e-3},  # only with a torque constant
    {"m": 1.0, "mm": 1e-3},
    {"N": 1.0},
    {"N m": 1.0, "Nm": 1.0, "mNm": 1e-3, "N cm": 1e-2, "kg cm": 9.80665e-2},
)
FACTORS = {unit: factor for quantity in QUANTITIES for unit, factor in quantity.items()}
_TIMES, _ANGLES, _SPEEDS, _CURRENTS, _LENGTHS, _FORCES, _TORQUES = QUANTITIES
_RATES = {**_ANGLES, **_SPEEDS}  # an angle's unit stands for one in a second
UNITS_OF = {  # signal -> unit that it may be in -> factor to SI; any of FACTORS for the others
    "time": _TIMES,
    **dict.fromkeys(("q", "q_cmd"), _ANGLES),
    **dict.fromkeys(("dq", "dq_cmd"), _RATES),
    **dict.fromkeys(("tau", "tau_cmd"), {**_CURRENTS, **_TORQUES}),
    **dict.fromkeys(("ee", "ee_cmd"), _LENGTHS),
    "ft": {**_FORCES, **_TORQUES},
}
AMPERES = (*_CURRENTS,)
OTHER = ("joints", "recording", "table", "motors")  # keys of a map that are not columns
SEPARATORS, DECIMALS = (",", ";", "\t", " "), (".", ",")


@dataclass(frozen=True)
class Source:
    """Source of a column or array: value = factor * raw + offset, with the offset in SI units.

    Attributes:
        name: name of the source's column; empty for a column that is declared missing.
        factor, offset: see above.
        plus: columns to add, such as nanoseconds to seconds, or another motor's angle.
    """

    name: str
    factor: float = 1.0
    offset: float = 0.0
    plus: tuple[Source, ...] = ()

    @property
    def names(self) -> set[str]:
        """Names of all source columns that the value is computed from."""
        return {self.name}.union(*(term.names for term in self.plus))


@dataclass(frozen=True)
class ColumnMap:
    """The content of a map file.

    Attributes:
        file: the file, or None without a map, when the source's names are used directly.
        columns: recording column (`time`, `episode`, `q.joint1`, or for arrays `q`) -> its source.
        joints: joint name -> its name in the source, if different.
        recording: further keys of recording.yaml (control, tool, torque_sensor, noise, ...).
        dialect: separators of a text table.
        rate_hz: sample rate of a log without time stamps, Hz; None for a log with time stamps.
        motors: joint -> motor -> factor, for logs of motor readings: a joint's angle is the sum over motors of factor
            times motor angle. A motor has the name of the joint whose columns hold its readings.
    """

    file: Path | None = None
    columns: Mapping[str, Source] = field(default_factory=dict)
    joints: Mapping[str, str] = field(default_factory=dict)
    recording: Mapping[str, Any] = field(default_factory=dict)
    dialect: Dialect = Dialect()
    rate_hz: float | None = None
    motors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def own(self) -> tuple[str, ...]:
        """Signals of user-defined channels that the header declares."""
        return tuple(map(str, self.recording.get("signals", ())))

    @property
    def in_degrees(self) -> bool:
        """Whether a measured angle is stated to be in degrees, of either sign."""
        angles = [origin for target, origin in self.columns.items() if target.partition(".")[0] == "q"]
        return any(abs(origin.factor) == FACTORS["deg"] for origin in angles)

    @property
    def names(self) -> set[str]:
        """Names of all columns of the source that the map names."""
        return set[str]().union(*(source.names for source in self.columns.values())) - {""}

    def by_own_name(self, targets: Iterable[str]) -> list[str]:
        """Return which columns of a recording are read from columns of the same name, as the map does not name them.

        These are all that a map without measured angles leaves out. A map with measured angles is complete: of what it
        leaves out only the time is read, since no recording is without it.
        """
        complete = any(target.partition(".")[0] == "q" for target in self.columns)
        return [target for target in targets if target not in self.columns and (target == "time" or not complete)]


def _example(folder: Path) -> Path:
    text = "time: {column: t, unit: ms}\nq.a: {column: A, unit: deg, scale: -1, offset: 0.1}\nq.b: B\n"
    text += "table: {separator: ';', decimal: ','}\njoints: {a: axis1}\n"
    text += "motors: {a: 1/8}\nrecording: {torque_sensor: joint, tool: {mass_kg: 1.0}}\n"
    (folder / "map.yaml").write_text(text, encoding="utf-8")
    return folder / "map.yaml"


@enrol("map of columns", _example)
def _read(file: Path) -> ColumnMap:
    return read_map(file, ["a", "b"])


def read_map(file: Path | None, joints: Sequence[str]) -> ColumnMap:
    """Read a map file for a robot with these joints; without a file, the source's names are used directly.

    A value is the source's name, or {column: .., unit: deg, scale: -1, offset: 0.1}: scale and unit multiply, the
    offset (SI, or the unit of a user-defined signal) is added last, and `plus` names a further column to add, or lists
    several. A torque in A or mA has a `torque_constant`, N m/A at the joint. `none` declares a column of missing
    readings.

    Raises:
        UserError: an unknown target, unit or key, or a value of the wrong kind.
    """
    return ColumnMap() if file is None else map_from(read_yaml(file), file, joints)


def map_from(data: Any, file: Path, joints: Sequence[str]) -> ColumnMap:
    """Parse a map from plain data; `file` is named in messages. Raises UserError as `read_map` does."""
    if not isinstance(data, dict):
        raise UserError("is not a mapping", file=file, expected="lines like 'q.joint1: pos_1'", got=data)
    recording = _section(data, "recording", file)
    listed = recording.get("joints", joints)
    names = listed if isinstance(listed, list) else list(joints)
    renamed = {str(key): str(value) for key, value in _section(data, "joints", file).items()}
    for joint in renamed:
        if joint not in names:
            raise UserError("no such joint", file=file, key="joints", got=joint, choices=map(str, names))
    own = _section(recording, "signals", file)  # of user-defined channels
    signals = (*SIGNALS, *map(str, own))
    targets = ["time", "episode", *signals, *(c for s in signals for c in columns_of(s, list(map(str, names))))]
    columns, rate, motors = {}, None, _motors(_section(data, "motors", file), [str(name) for name in names], file)
    by_motors = {*motors, *(motor for terms in motors.values() for motor in terms)}
    for target, value in data.items():
        if target in OTHER:
            continue
        if target == "time" and isinstance(value, dict) and [*value] == ["rate_hz"]:
            rate = checked_rate(value["rate_hz"], "time.rate_hz", file)
            continue
        if target not in targets:
            raise UserError("is not a column of a recording", file=file, got=target, choices=[*targets, *OTHER])
        joint = target.partition(".")[2]
        of_motor = joint in by_motors if joint else bool(by_motors)
        columns[target] = _source(value, target, file, _own_unit(own, target), of_motor)
    return ColumnMap(file, columns, renamed, recording, _dialect(_section(data, "table", file), file), rate, motors)


def _motors(section: dict, joints: Sequence[str], file: Path) -> dict[str, dict[str, float]]:
    """Parse the section `motors` to joint -> motor -> factor; a factor is a number or a fraction."""
    out = {}
    for joint, value in section.items():
        terms = value if isinstance(value, dict) else {joint: value}
        for name in (joint, *terms):
            if name not in joints:
                raise UserError("no such joint", file=file, key="motors", got=name, choices=joints)
        out[str(joint)] = {str(name): _factor(number, f"motors.{joint}", file) for name, number in terms.items()}
        if not out[str(joint)]:
            raise UserError("names no motor", file=file, key=f"motors.{joint}", expected="{motor: factor, ..}")
    return out


def _factor(value: Any, key: str, file: Path) -> float:
    """Parse a factor other than 0, a number or a fraction such as `1/8`."""
    parts = value.split("/") if isinstance(value, str) else [value]
    try:
        numbers = [float(part) for part in parts if not isinstance(part, bool)]
        number = numbers[0] if len(numbers) == 1 else numbers[0] / numbers[1]
    except (TypeError, ValueError, ZeroDivisionError, IndexError):
        number = math.nan
    if not 1e-6 <= abs(number) <= 1e6 or len(parts) > 2:
        expected = "joint angle over motor angle, such as 0.125 or 1/8"
        raise UserError("is no ratio", file=file, key=key, expected=expected, got=value)
    return number


def checked_rate(value: Any, key: str, file: Path | None = None) -> float:
    """Check a sample rate, Hz. Raises UserError: outside 1 to 100000 Hz."""
    number = not isinstance(value, bool) and isinstance(value, int | float)
    if not number or not 1 <= value <= 100_000:
        raise UserError("not a rate", file=file, key=key, expected="1 to 100000 samples a second", got=value)
    return float(value)


def _dialect(section: dict, file: Path) -> Dialect:
    dialect = {"separator": section.get("separator", ","), "decimal": section.get("decimal", ".")}
    for key in section:
        if key not in (*dialect, "columns"):
            raise UserError("unknown key", file=file, key="table", got=key, choices=(*dialect, "columns"))
    names = section.get("columns", [])
    if not isinstance(names, list) or not all(isinstance(name, str | int) for name in names):
        raise UserError("is not a list of names", file=file, key="table.columns", got=names)
    for key, choices in (("separator", SEPARATORS), ("decimal", DECIMALS)):
        if dialect[key] not in choices:
            names = [repr(choice) for choice in choices]
            raise UserError("cannot be read", file=file, key=f"table.{key}", got=dialect[key], choices=names)
    if dialect["separator"] == dialect["decimal"]:
        raise UserError(
            "uses the same sign between cells and as decimal mark", file=file, key="table", got=dialect["decimal"]
        )
    return Dialect(**dialect, names=tuple(map(str, names)))


def _section(data: dict, key: str, file: Path) -> dict:
    value = data.get(key) or {}
    if not isinstance(value, dict):
        raise UserError("is not a mapping", file=file, key=key, got=value)
    return value


def _own_unit(own: dict, target: str) -> str:
    """Return the unit that the header states if a column belongs to a user-defined signal; empty for other columns."""
    declared = own.get(target.partition(".")[0])
    return str(declared.get("unit", "")) if isinstance(declared, dict) else ""


def _unit(unit: Any, into: str, target: str, file: Path) -> float:
    """Return the factor from a unit to SI, or to the unit `into` of a user-defined signal, if that is not empty."""
    if unit is None or unit == into:
        return 1.0
    of_signal = UNITS_OF.get(target.partition(".")[0], FACTORS)
    # of a user-defined signal: the units that convert to its own
    known = of_signal if not into else next((q for q in QUANTITIES if into in q), {into: 1.0})
    if not isinstance(unit, str) or unit not in known:
        what = "is no unit of this signal" if isinstance(unit, str) and unit in FACTORS else "unknown unit"
        what = f"cannot be brought into {into}, the unit of this signal" if into else what
        raise UserError(what, file=file, key=target, got=unit, choices=known)
    return known[unit] / known.get(into, 1.0)


def _source(value: Any, target: str, file: Path, into: str = "", of_motor: bool = False) -> Source:
    """Parse one value of the map; `into` as for `_unit`, `of_motor`: whether the section `motors` converts it."""
    if value == "none":
        return Source("")
    if isinstance(value, str | int):
        return Source(str(value))
    if not isinstance(value, dict) or "column" not in value:
        raise UserError(
            "names no column", file=file, key=target, expected="a name or {column: .., unit: ..}", got=value
        )
    keys = ("column", "unit", "scale", "offset", "plus", "torque_constant")
    for key in value:
        if key not in keys:
            raise UserError("unknown key", file=file, key=target, got=key, choices=keys)
    _check_current(value, target, file, of_motor)
    factor = _unit(value.get("unit"), into, target, file)
    numbers = {}
    for key, default in (("scale", 1.0), ("offset", 0.0), ("torque_constant", 1.0)):
        number = value.get(key, default)
        if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number):
            raise UserError("is not a number", file=file, key=f"{target}.{key}", got=number)
        numbers[key] = float(number)
    added = value.get("plus", [])
    terms = added if isinstance(added, list) else [added]
    plus = tuple(_source(term, f"{target}.plus", file, into, of_motor) for term in terms)
    if not all(term.name for term in plus):
        raise UserError("names no column", file=file, key=f"{target}.plus", expected="{column: ..}", got=added)
    return Source(str(value["column"]), numbers["torque_constant"] * numbers["scale"] * factor, numbers["offset"], plus)


def _check_current(value: dict, target: str, file: Path, of_motor: bool) -> None:
    """Refuse a current without torque constant, a constant without current, or a current mapped to a non-torque.

    A torque constant is one at the joint, so it is refused where `motors` converts torques of motors.
    """
    constant, amperes = value.get("torque_constant"), value.get("unit") in AMPERES
    if target.partition(".")[0] not in SIGNALS and constant is None:
        return  # a user-defined channel may compare currents
    if amperes and target.partition(".")[0] not in ("tau", "tau_cmd"):
        raise UserError("a current is no reading of this", file=file, key=target, expected="tau.JOINT or tau_cmd.JOINT")
    if amperes and constant is None:
        expected = "torque_constant: N m/A at the joint, the motor's constant times the gear"
        raise UserError("a current needs its torque constant", file=file, key=target, expected=expected)
    if constant is not None and of_motor:
        expected = "no unit, and as scale N m/A at the motor"
        raise UserError(
            "`motors` would convert a constant at the joint again", file=file, key=target, expected=expected
        )
    if constant is not None and not amperes:
        raise UserError("has a torque constant but no current", file=file, key=target, expected="unit: A or mA")
    if isinstance(constant, int | float) and not isinstance(constant, bool) and constant <= 0:
        expected = "above 0; scale: -1 turns the sign"
        raise UserError("no torque constant", file=file, key=target, expected=expected, got=constant)
