"""World files, `vispeg-world/1`: a world's effects with the distributions of their parameters, and its task.

See docs/worlds.md for the keys. `load_world` takes a built-in world's name or a path.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from vispeg import worlds
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.formats.format import Format, enrol
from vispeg.formats.guard import is_file, read_bytes
from vispeg.formats.yaml_data import read_yaml
from vispeg.render.cameras.camera import FIELDS
from vispeg.render.cameras.standard import standard_cameras
from vispeg.robots.scene import Scene
from vispeg.task.config import TaskConfig
from vispeg.task.registry import config_of, digest_of, kind_of, task_of
from vispeg.task.world_robot import declared, identity
from vispeg.worlds.entry import entry_dict, ranged
from vispeg.worlds.identified import Identified, ranges_of
from vispeg.worlds.model_file import without_origin
from vispeg.worlds.places import MANY
from vispeg.worlds.randomized import RandomizedEffect, RandomizedWorld
from vispeg.worlds.world import World

FORMAT = "vispeg-world/1"
BUILT_IN = Path(worlds.__file__).parent / "library"
WORLD = Format(
    FORMAT, "a world", keys=("name", "about", "base", "robot", "model", "task", "cameras", "renderer", "effects")
)
FILES = 100  # greatest number of files of a world; bases that name bases could multiply without limit
# Fields of TaskConfig that were added after policies and results with a world's hash existed. At its default such a
# field does not enter the hash, so that those hashes stay valid. Add every new field here.
LATER = ("name", "fixture", "block", "success_lateral", "success_force", "reward", "robot", "avoid_limits")
LATER += ("guard_velocity", "guard_limit", "guard_singularity", "distractor_meshes")
CHANGED = FIELDS[1:]  # what a world may change of a standard camera: all but its name
RENDERER = {"backend": ("auto", "classic", "raycast", "filament"), "shadows": (False, True)}


@dataclass(frozen=True)
class WorldFile:
    """A world as its file states it.

    Attributes:
        name: of the world.
        world: its effects, from which episodes are drawn.
        task: fields of TaskConfig that the file and its bases state.
        cameras: by name, a camera file's path or a mapping of what differs from the standard camera.
        renderer: `backend` and `shadows`, if given.
        hash: SHA-256 (hex) of everything that affects episodes; names, comments and citations do not enter.
        path: of the file.
    """

    name: str
    world: RandomizedWorld
    task: Mapping[str, Any]
    cameras: Mapping[str, Any]
    renderer: Mapping[str, Any]
    hash: str
    path: Path

    def __repr__(self) -> str:
        return f"<WorldFile {self.name}: {self.world!r}>"


@dataclass
class _Parts:
    """A world file merged with its bases; `stated_at` holds the file and key that state each range."""

    ranges: dict[tuple[str, str], RandomizedEffect] = field(default_factory=dict)
    stated_at: dict[tuple[str, str], tuple[Path, str]] = field(default_factory=dict)
    task: dict[str, Any] = field(default_factory=dict)
    cameras: dict[str, Any] = field(default_factory=dict)
    renderer: dict[str, Any] = field(default_factory=dict)
    files: int = 0


def built_in() -> list[str]:
    """List the names of the built-in worlds."""
    return sorted(p.stem for p in BUILT_IN.glob("*.yaml"))


def by_name() -> dict[str, Path]:
    """Return name -> file of all worlds in the package: the built-in ones, and those of arms of MuJoCo Menagerie.

    The world of an arm loads only if that arm is installed.
    """
    named = {name: BUILT_IN / f"{name}.yaml" for name in built_in()}
    return named | {arm.stem: arm for arm in sorted((BUILT_IN / "arms").glob("*.yaml"))}


def is_world(source: str | Path) -> bool:
    """Return whether `source` is the name of a built-in world or a YAML file of a world. Raises UserError: bad YAML."""
    path = Path(source)
    if path.suffix.lower() not in (".yaml", ".yml"):
        return str(source) in built_in()
    data = read_yaml(path)
    return isinstance(data, dict) and data.get("format") == FORMAT


def _example(folder: Path) -> Path:
    searching = load_world("searching")
    base = folder / "base.yaml"
    base.write_text(world_text(searching), encoding="utf-8")
    camera = {"external": {"width": 64, "height": 48, "fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5}}
    late = {"effect": "command_delay", "params": {"delay": {"uniform": [0.0, 0.02]}}, "chance": 0.5}
    keys = {"name": "mine", "base": "base.yaml", "task": {"force_limit": 20.0}, "cameras": camera, "effects": [late]}
    (folder / "world.yaml").write_text(yaml.safe_dump({"format": FORMAT, **keys}), encoding="utf-8")
    return folder / "world.yaml"


@enrol(FORMAT, _example)
def load_world(source: str | Path) -> WorldFile:
    """Load a world by its built-in name or from a file.

    Raises:
        UserError: no such world, or a wrong file; it states file, key, value and choices.
    """
    path = _path(source, None)
    parts = _Parts()
    name = _collect(path, parts, ())
    # a range for one place comes last, so that it wins over one for many places (`_lay` has removed overridden ones)
    broad = [r for r in parts.ranges.values() if r.where in MANY]
    narrow = [r for r in parts.ranges.values() if r.where not in MANY]
    _check_rho(parts)
    config = config_of(parts.task, str(path))
    world = RandomizedWorld((*broad, *narrow), World(config.robot.model))
    ranges = [(r, *parts.stated_at[place]) for place, r in parts.ranges.items()]
    # checked once, after merging: a file may move the fixture to which ranges of its base refer
    task_of(config).check(task_of(config).cell(config), ranges, path)
    digest = world_hash(world, parts.task, parts.cameras, parts.renderer)
    return WorldFile(name, world, parts.task, parts.cameras, parts.renderer, digest, path)


def _check_rho(parts: _Parts) -> None:
    """Refuse groups whose correlations are all negative: their effects would move together, as with positive ones."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for place, r in parts.ranges.items():
        if r.rho:
            groups.setdefault(r.group, []).append(place)
    for name, places in groups.items():
        if all(parts.ranges[place].rho < 0 for place in places):
            file, key = parts.stated_at[places[0]]
            rho = parts.ranges[places[0]].rho
            expected = f"another effect of group '{name}' with a positive rho, against which this one moves"
            raise UserError(
                "a negative rho without a positive one", file=file, key=f"{key}.rho", expected=expected, got=rho
            )


def world_hash(
    world: RandomizedWorld | World,
    task: Mapping[str, Any] | TaskConfig | None = None,
    cameras: Mapping[str, Any] | None = None,
    renderer: Mapping[str, Any] | None = None,
) -> str:
    """Return the SHA-256 (hex) of everything that affects episodes in this world."""
    base, ranges = (world, ()) if isinstance(world, World) else (world.base, world.ranges)
    config = task if isinstance(task, TaskConfig) else config_of(task or {})
    entries = [{k: v for k, v in entry_dict(r).items() if k != "source"} for r in ranges]
    fixed = [without_origin(e) for e in base.effects]
    views = {n: _digest(c) if isinstance(c, str) else c for n, c in (cameras or {}).items()}
    config = replace(config, robot=replace(config.robot, repeatability=0.0))  # it affects no episode
    defaults = type(config)  # a dataclass keeps its defaults as class attributes
    unchanged = {k for k in LATER if getattr(config, k, None) == getattr(defaults, k, None)}
    settings = {k: v for k, v in asdict(config).items() if k not in unchanged}
    settings |= {k: _digests(settings[k]) for k in config.files if settings.get(k)}
    robot = identity(config.robot.model)
    if "robot" in settings:
        settings["robot"] |= {"model": robot, "tool": identity(config.robot.tool)}
        del settings["robot"]["repeatability"]
    if (code := digest_of(config.name)) is not None:
        settings["name"] = [config.name, code]
    content = [robot, base.tool, fixed, entries, settings, views, dict(renderer or {})]
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=list).encode()).hexdigest()


def world_text(file: WorldFile) -> str:
    """Return this world as the text of a single world file, without bases."""
    entries = [entry_dict(r) for r in file.world.ranges]
    entries += [_fixed(e) for e in file.world.base.effects]
    task = {k: v for k, v in file.task.items() if k != "robot"}
    robot = {"robot": file.task["robot"]} if "robot" in file.task else {}
    data = {"format": FORMAT, "name": file.name, **robot, "task": task}
    data |= {"cameras": file.cameras, "renderer": file.renderer}
    return yaml.safe_dump(data | {"effects": entries}, sort_keys=False, allow_unicode=True)


def _fixed(e: EffectInstance) -> Mapping[str, object]:
    return {"effect": e.effect, "where": e.where, "params": {k: v.value for k, v in e.params.items()}}


def _collect(path: Path, parts: _Parts, above: tuple[Path, ...]) -> str:
    """Add a file's content to `parts`: its bases first, then its model, then its own entries.

    Args:
        path: of the file.
        parts: filled in.
        above: files that name this one as a base, directly or not.

    Returns:
        The world's name.
    """
    if path in above:
        raise UserError("the world is based on itself", file=path, key="base", got=path.stem)
    parts.files += 1
    if parts.files > FILES:
        raise UserError("the world has too many files", file=path, key="base", expected=f"at most {FILES}")
    data = WORLD.read(path)
    name = _typed(data.get("name", path.stem), str, path, "name")
    bases = _given(data, "base", [])
    for base in [bases] if isinstance(bases, str) else _typed(bases, list, path, "base"):
        _collect(_path(base, path), parts, (*above, path))
    task = _typed(_given(data, "task", {}), Mapping, path, "task")
    if "robot" in task:
        raise UserError(
            "not a key of the task", file=path, key="task.robot", expected="`robot` at the top level, next to `task`"
        )
    if data.get("robot") is not None:
        task = {**task, "robot": declared(data["robot"], path, parts.task.get("robot", {}))}
    kind = kind_of({**parts.task, **task}, str(path))
    task = {**task, **{k: _placed(task[k], path) for k in kind.files if k in task}}
    name_of_task = {"name": parts.task["name"]} if "name" in parts.task else {}
    config_of({**name_of_task, **task}, str(path))  # its own settings must be valid without those of its bases
    parts.task |= task
    parts.cameras |= _cameras(_given(data, "cameras", {}), path)
    parts.renderer |= _renderer(_given(data, "renderer", {}), path)
    config = config_of(parts.task, str(path))
    identified: list[RandomizedEffect] = []
    if data.get("model") is not None:
        identified += ranges_of(Identified.of(data["model"], path), config.robot.model)
    entries = _typed(_given(data, "effects", []), list, path, "effects")
    # the cell is built only for entries: the robot may be missing, and a file based on this one may name another
    scene = _with_cameras(task_of(config).cell(config), parts.cameras) if entries else None
    own: dict[tuple[str, str], tuple[RandomizedEffect, str]] = {}
    for i, entry in enumerate(entries):
        r = ranged(entry, scene, path, f"effects[{i}]")
        if (r.effect, r.where) in own:
            raise UserError(f"{r.label} is given twice", file=path, key=f"effects[{i}]")
        above_it = [o for o, _ in own.values() if o.effect == r.effect and o.where in MANY and r.where in MANY]
        if above_it and r.chance == 1.0:  # of two at one place the later counts, see `places.values`
            expected = "one of both, or a `chance` below 1 of the later"
            raise UserError(
                f"{r.label} leaves nothing of {above_it[0].label}", file=path, key=f"effects[{i}]", expected=expected
            )
        own[r.effect, r.where] = r, f"effects[{i}]"
    _lay(parts, own, [r for r in identified if (r.effect, r.where) not in own], path)
    return name


def _with_cameras(scene: Scene, cameras: Mapping[str, Any]) -> Scene:
    """Return the cell with the world's own cameras as places of effects, beside the standard ones."""
    return replace(scene, cameras=tuple(dict.fromkeys((*scene.cameras, *cameras))))


def _lay(
    parts: _Parts,
    own: Mapping[tuple[str, str], tuple[RandomizedEffect, str]],
    identified: Sequence[RandomizedEffect],
    path: Path,
) -> None:
    """Add a file's ranges to `parts`, where a later range replaces an earlier one of the same effect and place.

    The order is: ranges for many places, identified ranges, ranges for one place. A range for many places also removes
    all ranges of its effect that the bases state.

    Args:
        parts: the merged bases; changed in place.
        own: the file's own ranges with their keys, by effect and place.
        identified: ranges from the file's `model`.
        path: of the file.
    """
    layer = [o for o in own.values() if o[0].where in MANY]
    layer += [(r, "model") for r in identified]
    layer += [o for o in own.values() if o[0].where not in MANY]
    many = {r.effect for r, _ in layer if r.where in MANY}
    for place in [place for place in parts.ranges if place[0] in many]:
        del parts.ranges[place]
    for r, key in layer:
        parts.ranges.pop((r.effect, r.where), None)  # so that the range is last in the dict
        parts.ranges[r.effect, r.where] = r
        parts.stated_at[r.effect, r.where] = path, key


def _path(source: str | Path, beside: Path | None) -> Path:
    """Return the path of a world's file.

    Args:
        source: a built-in name, or a path; a base may also be a built-in part.
        beside: the file that names `source` as its base, to which a path is relative; None for a world of the user.

    Raises:
        UserError: not a name or path, or an unknown name.
    """
    text = str(source)
    if not isinstance(source, str | Path) or not text:
        raise UserError("not a world", file=beside, key="base", expected="a name or a path", got=source)
    if Path(text).suffix.lower() not in (".yaml", ".yml"):
        named = by_name()
        if beside is not None:  # a part is only a base, not a world by itself
            named |= {part.stem: part for part in sorted((BUILT_IN / "parts").glob("*.yaml"))}
        if text in named:
            return named[text]
        expected = "a built-in world's name or a .yaml file"
        raise UserError("unknown world", file=beside, expected=expected, got=text, choices=list(named))
    return expanded(text) if beside is None else _beside(text, beside)


def _beside(text: str, file: Path) -> Path:
    return file.parent / expanded(text, file)  # an absolute path stays as it is


def _placed(stated: Any, file: Path) -> Any:
    """Return a setting of the task with its file paths made absolute from the world file's folder.

    Values that are not texts stay as they are.
    """
    if isinstance(stated, list | tuple):
        return [_placed(one, file) for one in stated]
    return str(_beside(stated, file).resolve()) if isinstance(stated, str) and stated else stated


def _given(data: Mapping[str, Any], key: str, otherwise: Any) -> Any:
    """Return the value of a key, or `otherwise` if it is absent or empty."""
    return otherwise if data.get(key) is None else data[key]


def _typed(value: Any, kind: type, path: Path, key: str) -> Any:
    if not isinstance(value, kind):
        what = {list: "a list", str: "a text"}.get(kind, "a mapping")
        raise UserError(f"wrong {key}", file=path, key=key, expected=what, got=value)
    return value


def _cameras(section: Any, path: Path) -> Mapping[str, Any]:
    """Read `cameras`, with paths made absolute from the file's folder. Mappings must make a possible camera."""
    out, usual = {}, {camera.name: camera for camera in standard_cameras()}
    for name, camera in _typed(section, Mapping, path, "cameras").items():
        if not isinstance(camera, str | Mapping):
            expected = "a camera file or a mapping"
            raise UserError("wrong camera", file=path, key=f"cameras.{name}", expected=expected, got=camera)
        if isinstance(camera, str) and not is_file(_beside(camera, path)):
            raise UserError("no such camera file", file=path, key=f"cameras.{name}", got=camera)
        changes = {} if isinstance(camera, str) else camera
        for key in changes:
            if key not in CHANGED:
                raise UserError("unknown key", file=path, key=f"cameras.{name}.{key}", got=key, choices=CHANGED)
        try:  # where a standard camera stands depends on the cell, but not whether these changes are possible
            usual.get(str(name), usual["external"]).moved(name=str(name), **changes)
        except UserError as error:
            raise UserError(str(error), file=path, key=f"cameras.{name}") from error
        out[str(name)] = _placed(camera, path) if isinstance(camera, str) else dict(camera)
    return out


def _renderer(section: Any, path: Path) -> Mapping[str, Any]:
    for key, value in _typed(section, Mapping, path, "renderer").items():
        if key not in RENDERER:
            raise UserError("unknown key", file=path, key=f"renderer.{key}", got=key, choices=RENDERER)
        if value not in RENDERER[key] or isinstance(value, bool) != (key == "shadows"):  # Python takes 1 for True
            choices = [str(c).lower() for c in RENDERER[key]]
            raise UserError("unknown choice", file=path, key=f"renderer.{key}", got=value, choices=choices)
    return dict(section)


def _digests(stated: str | Sequence[str]) -> str | list[str]:
    """Return the SHA-256 (hex) of the file that a setting names, or of each of several."""
    return _digest(stated) if isinstance(stated, str) else [_digest(file) for file in stated]


def _digest(file: str) -> str:
    return hashlib.sha256(read_bytes(file)).hexdigest()


def parts(source: str | Path) -> dict[str, str]:
    """Return the parts of a valid world: SHA-256 (hex) of the content that each file adds -> the file's world name.

    Only effects and models count. A shared name, task or renderer does not make two worlds related, and a file that
    only combines other files adds nothing.
    """
    names: dict[str, str] = {}
    for path, data in _files(source):
        effects = [{k: v for k, v in entry.items() if k != "source"} for entry in _given(data, "effects", [])]
        model: Any = None
        if data.get("model") is not None:
            stated = Identified.of(data["model"], path)
            model = _digest(str(stated.file))
            if isinstance(data["model"], Mapping):
                model = [model, stated.widen, stated.sd]
        if effects or model:
            content = json.dumps([effects, model], sort_keys=True)
            names[hashlib.sha256(content.encode()).hexdigest()] = str(data.get("name", path.stem))
    return names


def files(source: str | Path) -> list[Path]:
    """Return the resolved paths of a valid world's file and of all its bases."""
    return [path.resolve() for path, _ in _files(source)]


def _files(source: str | Path) -> Iterator[tuple[Path, Mapping[str, Any]]]:
    """Yield path and content of a world's file and of all its bases, each once."""
    todo, visited = [_path(source, None)], set()
    while todo:
        path = todo.pop()
        if path.resolve() in visited:
            continue
        visited.add(path.resolve())
        data = WORLD.read(path)
        bases = _given(data, "base", [])
        todo += [_path(base, path) for base in ([bases] if isinstance(bases, str) else bases)]
        yield path, data
