"""What recording.yaml may hold, and how it is read without trusting it."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, field_validator

from vispeg.core.errors import UserError

FORMAT = "vispeg-recording/1"
MAX_BYTES = 1_000_000
MAX_NODES = 20_000  # after aliases are expanded: nested aliases can stand for billions
MAX_JOINTS = 64

KINDS = {  # pydantic's complaint: what a person would have had to write
    "model_type": "a mapping of keys to values",
    "list_type": "a list",
    "string_type": "text",
    "float_type": "a number",
    "float_parsing": "a number",
}

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Gain = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Vec3 = Annotated[list[Finite], Field(min_length=3, max_length=3)]
NoneWord = BeforeValidator(lambda value: None if value == "none" else value)


class _Section(BaseModel):
    model_config = ConfigDict(extra="allow", frozen=True)


class NullspaceSection(_Section):
    """OSC posture task."""

    kp: Gain
    kd: Gain
    q: list[Finite]


class ControlSection(_Section):
    """The controller that ran."""

    mode: Literal["torque", "position", "osc", "passive", "unknown"] = "unknown"
    rate_hz: Positive | None = None
    gravity_compensation: Literal["model", "none"] = "none"
    kp: list[Gain] | None = None
    kd: list[Gain] | None = None
    nullspace: NullspaceSection | None = None


class ToolSection(_Section):
    """What is bolted to the flange."""

    mass_kg: Gain
    com_m: Vec3 = [0.0, 0.0, 0.0]
    inertia_kgm2: Annotated[list[Gain], Field(min_length=3, max_length=3)] = [0.0, 0.0, 0.0]
    name: str | None = None


class BaseSection(_Section):
    """How the user believes the base is mounted."""

    tilt_rad: Annotated[list[Annotated[float, Field(ge=-math.pi, le=math.pi)]], Field(min_length=2, max_length=2)] = [
        0.0,
        0.0,
    ]


class NoiseSection(_Section):
    """1-sigma noise, only what is known: rad, rad/s, N m, m."""

    q: Positive | None = None
    dq: Positive | None = None
    tau: Positive | None = None
    ee: Positive | None = None


class Header(_Section):
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
    motion: str = ""
    notes: str = ""

    @field_validator("joints")
    @classmethod
    def _names(cls, joints: list[str]) -> list[str]:
        twice = sorted({name for name in joints if joints.count(name) > 1})
        if twice:
            raise ValueError(f"joints named twice: {', '.join(twice)}")
        odd = [name for name in joints if name != name.strip() or not name.isprintable() or set(name) & {",", '"'}]
        if odd:
            raise ValueError(f"joint name cannot head a CSV column: {odd[0]!r}")
        return joints


def read_header(file: Path) -> Header:
    """Reads and validates recording.yaml. Raises UserError; warns once about keys that this version does not know."""
    return header_from(read_yaml(file), file)


def header_from(data: Any, file: Path) -> Header:
    """Validates what recording.yaml, or something that stands for it, holds; `file` is what messages name."""
    if not isinstance(data, dict):
        raise UserError("is not a mapping", file=file, expected=f"'format: {FORMAT}' and further keys", got=data)
    try:
        header = Header.model_validate(data)
    except ValidationError as error:
        raise as_user_error(error, file) from error
    unknown = _unknown(header)
    if unknown:
        warnings.warn(f"{file}: unknown keys are ignored: {', '.join(map(str, unknown))}", stacklevel=3)
    return header


def plain(section: BaseModel) -> dict[str, Any]:
    """What is given of a section, without keys that this version does not know."""
    return section.model_dump(exclude_none=True, include=set(type(section).model_fields))


def read_yaml(file: Path) -> Any:
    """Plain data from a YAML file of unknown origin: no tags, no repeated keys, no alias bombs, at most 1 MB."""
    try:
        if file.stat().st_size > MAX_BYTES:
            raise UserError("is too large for a header", file=file, expected=f"at most {MAX_BYTES} bytes")
        text = file.read_bytes().decode("utf-8-sig")
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        if node is None:
            raise UserError("is empty", file=file)
        _expanded(node, file, {}, set())
        return yaml.safe_load(text)
    except OSError as error:
        raise UserError(f"cannot be read: {error.strerror}", file=file) from error
    except UnicodeDecodeError as error:
        raise UserError(f"is not UTF-8 text (byte {error.start})", file=file) from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        said = getattr(error, "problem", None) or "cannot be parsed"
        key = f"line {mark.line + 1}" if mark is not None else None
        raise UserError(f"is not valid YAML: {said}", file=file, key=key) from error
    except RecursionError as error:
        raise UserError("is nested too deeply", file=file) from error
    except (
        ValueError,
        TypeError,
        OverflowError,
        KeyError,
    ) as error:  # PyYAML: 2024-99-99, `? []`
        raise UserError(f"holds a value that cannot be read: {error}", file=file) from error


def as_user_error(error: ValidationError, file: Path) -> UserError:
    """The first of pydantic's complaints in one line, with the choices where there are any."""
    first = error.errors(include_url=False)[0]
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in first["loc"]).lstrip(".") or None
    context = first.get("ctx", {})
    if first["type"] == "missing":
        return UserError("is missing", file=file, key=key)
    if first["type"] == "literal_error":
        choices = [part.strip(" '") for part in str(context["expected"]).replace(" or ", ", ").split(",")]
        return UserError("is not one of the choices", file=file, key=key, got=first["input"], choices=choices)
    if first["type"] in KINDS:
        return UserError("is of another kind", file=file, key=key, expected=KINDS[first["type"]], got=first["input"])
    said = first["msg"].removeprefix("Value error, ")
    return UserError(said[:1].lower() + said[1:], file=file, key=key, got=first["input"])


def _expanded(node: yaml.Node, file: Path, sizes: dict[int, int], open_: set[int]) -> int:
    """Number of nodes below `node` with aliases expanded; refuses cycles, bombs and repeated keys."""
    if id(node) in sizes:
        return sizes[id(node)]
    if id(node) in open_:
        raise UserError("an alias refers to itself", file=file, key=f"line {node.start_mark.line + 1}")
    open_.add(id(node))
    total = 1
    if isinstance(node, yaml.MappingNode):
        seen: set[str] = set()
        for key, value in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen:
                    raise UserError("is given twice", file=file, key=f"line {key.start_mark.line + 1}: {key.value}")
                seen.add(key.value)
            total += _expanded(key, file, sizes, open_) + _expanded(value, file, sizes, open_)
    elif isinstance(node, yaml.SequenceNode):
        total += sum(_expanded(item, file, sizes, open_) for item in node.value)
    if total > MAX_NODES:
        raise UserError("holds too many values for a header", file=file, expected=f"at most {MAX_NODES}")
    open_.discard(id(node))
    sizes[id(node)] = total
    return total


def _unknown(section: BaseModel, prefix: str = "") -> list[str]:
    found = [f"{prefix}{key}" for key in section.model_extra or {}]
    for name in type(section).model_fields:
        value = getattr(section, name)
        if isinstance(value, BaseModel):
            found += _unknown(value, f"{prefix}{name}.")
    return found
