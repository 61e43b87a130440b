"""The commands there are, by section, and what `vispeg --help` prints of them."""

from __future__ import annotations

import ast
import importlib.util
from pathlib import Path

# Name -> module, which is imported when its command runs, so that help stays quick.
SECTIONS: dict[str, dict[str, str]] = {
    "start here": {
        "demo": "vispeg.cli.demo",
        "doctor": "vispeg.cli.machine.doctor",
        "view": "vispeg.cli.view",
    },
    "recordings": {
        "check": "vispeg.cli.recordings.check",
        "convert": "vispeg.cli.recordings.convert",
        "record": "vispeg.cli.recordings.record",
        "motions": "vispeg.cli.recordings.motions",
    },
    "models of robots": {
        "compare": "vispeg.cli.models.compare",
        "diagnose": "vispeg.cli.models.diagnose",
        "fit": "vispeg.cli.models.fit",
        "effects": "vispeg.cli.models.effects",
        "robots": "vispeg.cli.models.robots",
        "add": "vispeg.cli.models.add",
        "measure": "vispeg.cli.measuring.measure",
        "report": "vispeg.cli.models.report",
    },
    "cameras and datasets": {
        "camera": "vispeg.cli.pictures.camera",
        "render": "vispeg.cli.pictures.render",
        "dataset": "vispeg.cli.pictures.dataset",
    },
    "policies": {
        "worlds": "vispeg.cli.learning.worlds",
        "policies": "vispeg.cli.learning.policies",
        "train": "vispeg.cli.learning.train",
        "play": "vispeg.cli.learning.play",
        "finetune": "vispeg.cli.learning.finetune",
        "combine": "vispeg.cli.learning.combine",
        "export": "vispeg.cli.learning.export",
        "run": "vispeg.cli.learning.run",
    },
    "evaluation of policies": {
        "plan": "vispeg.cli.evaluation.plan",
        "evaluate": "vispeg.cli.evaluation.evaluate",
        "gap": "vispeg.cli.evaluation.gap",
        "suite": "vispeg.cli.evaluation.suite",
        "sensitivity": "vispeg.cli.evaluation.sensitivity",
        "exploit": "vispeg.cli.evaluation.exploit",
        "explain": "vispeg.cli.evaluation.explain",
        "perturb": "vispeg.cli.evaluation.perturb",
    },
    "other": {
        "completion": "vispeg.cli.machine.completion",
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


def available() -> dict[str, str]:
    """Name -> first line of help of every command in this installation, without importing any of them."""
    lines = {}
    for name, module in COMMANDS.items():
        spec = importlib.util.find_spec(module)
        if spec is not None and spec.origin is not None:
            doc = ast.get_docstring(ast.parse(Path(spec.origin).read_text(encoding="utf-8"))) or ""
            lines[name] = doc.partition("\n")[0]
    return lines


def overview() -> str:
    """Give what `vispeg --help` prints."""
    lines = available()
    width = max(map(len, lines), default=0)
    blocks = []
    for title, names in SECTIONS.items():
        rows = [f"  {name:<{width}}  {lines[name]}" for name in names if name in lines]
        blocks += ["\n".join((f"{title}:", *rows))] if rows else []
    return "\n\n".join((HEAD, *blocks, FOOT))
