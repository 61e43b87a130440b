"""Read and write `vispeg-model/1` files: a robot plus effects."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import yaml

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.core.params import Param, Value
from vispeg.core.paths import expanded
from vispeg.formats.format import Format, enrol
from vispeg.formats.guard import is_file
from vispeg.formats.typed import typed
from vispeg.recordings.cell import OPEN_CELL, CellBelief
from vispeg.recordings.load_cell import cell
from vispeg.recordings.schema import CellOf
from vispeg.robots import gripper, tools
from vispeg.robots.model import check_name
from vispeg.worlds.world import World

FORMAT = "vispeg-model/1"
MODEL = Format(FORMAT, "a model", keys=("robot", "tool", "cell", "effects"))
ENTRY = ("effect", "where", "params", "partial", "tentative", "origin")  # keys of one effect
PARTS = ("value", "low", "high", "unit")  # keys of one parameter
MARKS = ("partial", "tentative")  # keys of one effect that are true or false
DEFAULT = "iiwa14"  # robot of a file that states neither robot nor cell


class Plain(yaml.SafeDumper):
    """A YAML writer that repeats an object that is shared, such as an origin of two effects, without aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        """Disable aliases for all data."""
        return True


def _example(folder: Path) -> Path:
    friction = EffectInstance.of("coulomb_friction", "joint4", torque=1.2)
    tool = {"mass_kg": 0.5, "com_m": [0.0, 0.0, 0.05], "inertia_kgm2": [1e-3, 1e-3, 1e-3]}
    (folder / "model.yaml").write_text(model_text(World("iiwa14", tool, (friction,))), encoding="utf-8")
    return folder / "model.yaml"


@enrol(FORMAT, _example)
def load_model(source: str | Path) -> World:
    """Load a World.

    Args:
        source: a model file; or a robot's name or a path to an MJCF or URDF file, for that robot without effects; or
            OPEN_CELL, for the cell that each recording states.

    Raises:
        UserError: an unreadable file, another format, or a wrong entry; it names file and key.
    """
    text = str(source)
    path = Path(text)
    if text == OPEN_CELL:
        return World(DEFAULT, tools.CELL, cell=CellBelief(OPEN_CELL))
    if path.suffix.lower() not in (".yaml", ".yml"):
        return World(robot=text)
    data = MODEL.read(path)
    effects = _effects(data, path)
    tool = data.get("tool")
    if tool is not None and not isinstance(tool, str | Mapping):
        raise UserError("wrong tool", file=path, key="tool", expected="none, a name or a mapping", got=tool)
    belief = _belief(data, path)
    robot = _robot(data, belief, path)
    check_name(robot, path, "robot")
    tool = gripper.renamed(tool, lambda named: located(named, path))
    return World(robot, None if tool in (None, "none") else tool, effects, belief)


def _effects(data: Mapping[str, Any], file: Path) -> tuple[EffectInstance, ...]:
    """Read the key `effects`. Raises UserError: it is no list, or an entry is wrong or given twice."""
    entries = data.get("effects") or []
    if not isinstance(entries, list):
        raise UserError("wrong effects", file=file, key="effects", expected="a list", got=type(entries).__name__)
    effects = tuple(read_placed(entry, file, f"effects[{i}]") for i, entry in enumerate(entries))
    earlier = set()
    for i, e in enumerate(effects):
        if (e.effect, e.where) in earlier:
            raise UserError(f"{e.label} is given twice", file=file, key=f"effects[{i}]")
        earlier.add((e.effect, e.where))
    return effects


def _belief(data: Mapping[str, Any], file: Path) -> CellBelief | None:
    """Read the key `cell`; None without a task's cell. Raises UserError: a wrong cell, or one with a board."""
    stated = data.get("cell")
    belief = cell(None if stated is None else typed(CellOf, {"cell": stated}, file).cell, file)
    if belief is None or not belief.bench:
        return belief
    if belief.board:
        raise UserError("is stated by the recordings", file=file, key="cell.board", expected="no board in a model")
    return None  # a model without a cell has the scene of its robot's file


def _robot(data: Mapping[str, Any], belief: CellBelief | None, file: Path) -> str:
    """Return the robot that the file states, else its cell's, else DEFAULT; "" if the cell's world determines it.

    Raises:
        UserError: it is no text.
    """
    if "robot" not in data and belief is not None:
        named = belief.robot.get("model") if isinstance(belief.robot, Mapping) else belief.robot
        return str(named or ("" if belief.world and not belief.open else DEFAULT))
    robot = data.get("robot", DEFAULT)
    if not isinstance(robot, str) or not robot:
        raise UserError("wrong robot", file=file, key="robot", expected="a name or a path", got=robot)
    return located(robot, file)


def located(named: str, file: Path) -> str:
    """Return a robot or tool that `file` names. A path relative to the folder of `file` gets the folder prepended."""
    beside = file.parent / named
    return str(beside) if Path(named).suffix and not Path(named).is_absolute() and is_file(beside) else named


def read_placed(entry: Any, file: Path, key: str) -> EffectInstance:
    """Read one entry of `effects` in a model file. Raises UserError, which names file and key, for a wrong entry."""
    if not isinstance(entry, Mapping):
        raise UserError("wrong entry", file=file, key=key, expected="a mapping with effect, where, params", got=entry)
    unknown = sorted(str(k) for k in set(entry) - set(ENTRY))
    if unknown:
        raise UserError("unknown key", file=file, key=f"{key}.{unknown[0]}", choices=ENTRY)
    kind = effect(entry.get("effect"), file=file, key=f"{key}.effect")
    where = entry.get("where", "all")
    if not isinstance(where, str):
        raise UserError("wrong place", file=file, key=f"{key}.where", expected="a name", got=where)
    values = entry.get("params") or {}
    if not isinstance(values, Mapping):
        raise UserError("wrong params", file=file, key=f"{key}.params", expected="a mapping", got=values)
    params = dict(EffectInstance.of(kind.name, where).params)
    for parameter, value in values.items():
        at = f"{key}.params.{parameter}"
        params[parameter] = _value(value, kind.param(parameter, file=file, key=at), file, at)
    origin = entry.get("origin") or {}
    if not isinstance(origin, Mapping):
        raise UserError("wrong origin", file=file, key=f"{key}.origin", expected="a mapping", got=origin)
    marks = {mark: entry.get(mark, False) for mark in MARKS}
    for mark, value in marks.items():
        if not isinstance(value, bool):
            raise UserError("wrong mark", file=file, key=f"{key}.{mark}", expected="true or false", got=value)
    return EffectInstance(kind.name, where, params, dict(origin), **marks)


def _value(value: Any, param: Param, file: Path, key: str) -> Value:
    """Read a parameter's value: a number, or a mapping with value, low, high and unit.

    Raises:
        UserError: an unknown key, another unit, a part that is no finite number, a value out of bounds, or an inverted
            interval.
    """
    raw = value if isinstance(value, Mapping) else {"value": value}
    unknown = [str(k) for k in raw if k not in PARTS]
    if unknown:
        raise UserError("unknown key", file=file, key=f"{key}.{unknown[0]}", choices=PARTS)
    unit = raw.get("unit", param.unit)
    if unit != param.unit:
        raise UserError("wrong unit", file=file, key=f"{key}.unit", expected=param.unit, got=unit)
    numbers = {}
    for part in ("value", "low", "high"):
        number = raw.get(part)
        if number is None and part != "value":
            numbers[part] = None
            continue
        if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number):
            raise UserError("not a number", file=file, key=f"{key}.{part}", expected="a finite number", got=number)
        numbers[part] = float(number)
    if not param.low <= numbers["value"] <= param.high:
        raise UserError(
            "out of bounds",
            file=file,
            key=key,
            expected=f"{param.low:g} to {param.high:g} {param.unit}",
            got=numbers["value"],
        )
    low, high = numbers["low"], numbers["high"]
    if low is not None and high is not None and low > high:
        raise UserError("interval is inverted", file=file, key=key, expected="low <= high", got=[low, high])
    return Value(numbers["value"], low, high)


class PlacedRecord(TypedDict):
    """An entry of `effects` in a model file; each parameter has a value, and may have low, high and unit."""

    effect: str
    where: str
    params: dict[str, dict[str, float | str]]
    partial: NotRequired[bool]
    tentative: NotRequired[bool]
    origin: NotRequired[Mapping[str, object]]


def placed_dict(placed: EffectInstance) -> PlacedRecord:
    """Return the YAML/JSON form of a placed effect."""
    params = {}
    for name, v in placed.params.items():
        entry: dict[str, float | str] = {"value": float(v.value)}
        if v.low is not None and v.high is not None:
            entry |= {"low": float(v.low), "high": float(v.high)}
        params[name] = {**entry, "unit": effect(placed.effect).params[name].unit}
    out: PlacedRecord = {"effect": placed.effect, "where": placed.where, "params": params}
    if placed.partial:
        out["partial"] = True
    if placed.tentative:
        out["tentative"] = True
    if placed.origin:
        out["origin"] = dict(placed.origin)
    return out


def without_origin(placed: EffectInstance) -> PlacedRecord:
    """Return the YAML/JSON form of a placed effect without the origin of its values."""
    out = placed_dict(placed)
    out.pop("origin", None)
    return out


def named_from(world: World, folder: Path) -> World:
    """Return the world for a model file in `folder`: paths of robot and tool become relative to the folder."""

    def seen(path: str) -> str:
        if not (Path(path).suffix and is_file(path)):
            return path
        return os.path.relpath(expanded(path).resolve(), expanded(folder).resolve())

    return replace(world, robot=seen(world.robot), tool=gripper.renamed(world.tool, seen))


def write_model(path: Path, world: World, overwrite: bool = False) -> Path:
    """Write a world's model file, which `load_model` reads in any working directory; return its path.

    Raises:
        UserError: `path` exists while `overwrite` is False, or cannot be written.
    """
    return write_text_atomic(path, model_text(named_from(world, path.parent)), overwrite=overwrite)


def model_text(world: World) -> str:
    """Return the text of a world's model file, the inverse of `load_model`."""
    tool = world.tool if isinstance(world.tool, str) or world.tool is None else dict(world.tool)
    data = {
        "format": FORMAT,
        "robot": world.robot,
        "tool": "none" if tool is None else tool,
        **({} if world.cell is None else {"cell": world.cell.plain()}),
        "effects": [placed_dict(e) for e in world.effects],
    }
    return yaml.dump(data, Dumper=Plain, sort_keys=False, allow_unicode=True)
