"""All commands by section, and the text of `vispeg --help`."""

from __future__ import annotations

import ast
import importlib.util
import shutil
import textwrap
from collections.abc import Mapping
from functools import cache
from pathlib import Path

# Name -> MODULE:FUNCTION of the command, or MODULE of its sub-commands. A module is imported when its command runs.
SECTIONS: dict[str, dict[str, str]] = {
    "start here": {
        "demo": "vispeg.cli.demo:demo",
        "doctor": "vispeg.cli.doctor",
        "view": "vispeg.cli.view:view",
    },
    "recordings": {
        "check": "vispeg.cli.recordings:check",
        "convert": "vispeg.cli.recordings:convert",
        "record": "vispeg.cli.recordings:record",
        "motions": "vispeg.cli.recordings:motions",
    },
    "models of robots": {
        "compare": "vispeg.cli.models:compare",
        "diagnose": "vispeg.cli.models:diagnose",
        "fit": "vispeg.cli.models:fit",
        "effects": "vispeg.cli.models:effects",
        "robots": "vispeg.cli.models:robots",
        "add": "vispeg.cli.models:add",
        "measure": "vispeg.cli.measure",
        "report": "vispeg.cli.models:report",
    },
    "cameras and datasets": {
        "camera": "vispeg.cli.cameras",
        "render": "vispeg.cli.render:render",
        "dataset": "vispeg.cli.datasets",
    },
    "policies": {
        "worlds": "vispeg.cli.policies:worlds",
        "policies": "vispeg.cli.policies:policies",
        "train": "vispeg.cli.policies:train",
        "play": "vispeg.cli.policies:play",
        "finetune": "vispeg.cli.policies:finetune",
        "combine": "vispeg.cli.policies:combine",
        "export": "vispeg.cli.policies:export",
        "run": "vispeg.cli.run:run",
    },
    "evaluation of policies": {
        "plan": "vispeg.cli.judging:plan",
        "evaluate": "vispeg.cli.judging:evaluate",
        "gap": "vispeg.cli.judging:gap",
        "suite": "vispeg.cli.suite",
        "sensitivity": "vispeg.cli.judging:sensitivity",
        "exploit": "vispeg.cli.judging:exploit",
        "explain": "vispeg.cli.judging:explain",
        "perturb": "vispeg.cli.judging:perturb",
    },
    "other": {
        "completion": "vispeg.cli.completion:completion",
    },
}
COMMANDS = {name: module for section in SECTIONS.values() for name, module in section.items()}
HEAD = """usage: vispeg COMMAND [ARGUMENTS]

Finds what a robot model is missing, from recordings of the real robot, and
trains insertion policies in simulation on what it found."""
FOOT = """`vispeg help COMMAND` or `vispeg COMMAND --help` shows arguments and
examples; `vispeg --version` the version. Example:

  vispeg diagnose iiwa14 --recording rig-a --recording rig-b \\
      --validate rig-c --out found"""


def installed() -> list[str]:
    """Return the names of the installed commands, without importing any."""
    return [name for name, place in COMMANDS.items() if _source(place) is not None]


def page(name: str, below: Mapping[str, str]) -> str:
    """Return the help text of a command with sub-commands, from the first line of each."""
    from vispeg.cli.help import wrapped

    columns = _columns()
    usage = wrapped(f"usage: vispeg {name} COMMAND [ARGUMENTS]", columns)
    rows = _listed(below, max(map(len, below)), columns)
    return "\n\n".join((usage, wrapped(doc(COMMANDS[name]), columns), "\n".join(("commands:", *rows))))


def _columns() -> int:
    from vispeg.cli.help import WIDEST

    return min(shutil.get_terminal_size().columns, WIDEST)


def _listed(lines: Mapping[str, str], width: int, columns: int) -> list[str]:
    """Return names, padded to `width`, and what each does, wrapped to `columns` beside the name."""
    below = " " * (width + 4)
    texts = (f"{name:<{width}}  {line}" for name, line in lines.items())
    return [textwrap.fill(text, columns, initial_indent="  ", subsequent_indent=below) for text in texts]


def _source(place: str) -> Path | None:
    spec = importlib.util.find_spec(place.partition(":")[0])
    return None if spec is None or spec.origin is None else Path(spec.origin)


@cache
def _tree(source: Path) -> ast.Module:
    return ast.parse(source.read_text(encoding="utf-8"))


def doc(place: str) -> str:
    """Return the docstring of MODULE:FUNCTION, or of MODULE."""
    source, name = _source(place), place.partition(":")[2]
    assert source is not None
    tree = _tree(source)
    named = (node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == name)
    return ast.get_docstring(next(named, tree)) or ""


def overview() -> str:
    """Return the text of `vispeg --help`."""
    from vispeg.cli.help import wrapped

    columns = _columns()
    lines = {name: doc(COMMANDS[name]).partition("\n")[0] for name in installed()}
    width = max(map(len, lines), default=0)
    blocks = []
    for title, names in SECTIONS.items():
        rows = _listed({name: lines[name] for name in names if name in lines}, width, columns)
        blocks += ["\n".join((f"{title}:", *rows))] if rows else []
    return "\n\n".join((wrapped(HEAD, columns), *blocks, wrapped(FOOT, columns)))
