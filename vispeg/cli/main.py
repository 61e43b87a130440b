"""The command `vispeg`: finds the sub-command's module, parses its arguments, and turns errors into exit codes."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import os
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from vispeg import __version__
from vispeg.api.machine.graphics import choose_backend
from vispeg.core.disk import FULL, refused, why
from vispeg.core.errors import UserError
from vispeg.core.extras import lacks, missing
from vispeg.core.interrupt import Interrupted
from vispeg.core.lock import release
from vispeg.core.provenance import command_line

# In the order in which a newcomer meets them. A module is imported when its command runs, so that help stays quick.
COMMANDS: dict[str, str] = {
    "demo": "vispeg.cli.demo",
    "check": "vispeg.cli.recordings.check",
    "convert": "vispeg.cli.recordings.convert",
    "compare": "vispeg.cli.models.compare",
    "diagnose": "vispeg.cli.models.diagnose",
    "fit": "vispeg.cli.models.fit",
    "add": "vispeg.cli.models.add",
    "effects": "vispeg.cli.models.effects",
    "motions": "vispeg.cli.recordings.motions",
    "record": "vispeg.cli.recordings.record",
    "measure": "vispeg.cli.measuring.measure",
    "camera": "vispeg.cli.pictures.camera",
    "report": "vispeg.cli.models.report",
    "view": "vispeg.cli.view",
    "render": "vispeg.cli.pictures.render",
    "dataset": "vispeg.cli.pictures.dataset",
    "worlds": "vispeg.cli.learning.worlds",
    "policies": "vispeg.cli.learning.policies",
    "train": "vispeg.cli.learning.train",
    "play": "vispeg.cli.learning.play",
    "finetune": "vispeg.cli.learning.finetune",
    "combine": "vispeg.cli.learning.combine",
    "export": "vispeg.cli.learning.export",
    "evaluate": "vispeg.cli.evaluation.evaluate",
    "gap": "vispeg.cli.evaluation.gap",
    "suite": "vispeg.cli.evaluation.suite",
    "sensitivity": "vispeg.cli.evaluation.sensitivity",
    "exploit": "vispeg.cli.evaluation.exploit",
    "perturb": "vispeg.cli.evaluation.perturb",
    "hub": "vispeg.cli.hub.command",
    "completion": "vispeg.cli.machine.completion",
    "doctor": "vispeg.cli.machine.doctor",
}
EXIT_USAGE, EXIT_INTERRUPT, EXIT_PIPE = 2, 130, 141


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
    """What `vispeg --help` prints."""
    commands = available()
    width = max(map(len, commands), default=0)
    rows = "\n".join(f"  {name:<{width}}  {line}" for name, line in commands.items())
    return (
        "usage: vispeg COMMAND [ARGUMENTS]\n\n"
        "Finds what a robot model is missing, from recordings of the real robot.\n\n"
        f"commands:\n{rows}\n\n"
        "`vispeg COMMAND --help` shows its arguments and an example; `vispeg --version` the version.\n"
        "example: vispeg diagnose iiwa14 --recording rig-a --recording rig-b --validate rig-c --out found"
    )


def run(argv: Sequence[str]) -> int:
    """Runs one command line (without the program's name). Raises UserError on bad input."""
    if not argv or argv[0] in ("-h", "--help", "help"):
        print(overview())
        return 0 if argv else EXIT_USAGE
    if argv[0] in ("-V", "--version"):
        print(f"vispeg {__version__}")
        return 0
    commands = available()
    if argv[0] not in commands:
        raise UserError("unknown command", got=argv[0], choices=commands)
    from vispeg.cli.usage import parse

    choose_backend()
    module = importlib.import_module(COMMANDS[argv[0]])
    special = getattr(module, "parse", None)  # the doctor's, who has to work where the parser is what is missing
    args = special(argv[1:]) if special else parse(module.Args, f"vispeg {argv[0]}", module.__doc__, argv[1:])
    output = getattr(args, "output", getattr(getattr(args, "command", None), "output", None))
    if output is not None and output.quiet:
        warnings.showwarning = lambda *_, **__: None
    return int(args.run() or 0)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point. Exit codes: 0 done, 2 bad input or usage, 130 interrupted, 141 the output's reader went away."""
    warnings.showwarning = _note
    argv = [*(sys.argv[1:] if argv is None else argv)]
    try:
        code = run(argv)
        sys.stdout.flush()
        return code
    except UserError as error:
        return _refuse(error)
    except ImportError as error:
        if (module := lacks(error)) is None:
            raise
        return _refuse(missing(module, f"vispeg {argv[0]}"))
    except Interrupted as stop:
        print(f"vispeg: interrupted; this goes on: {command_line(['vispeg', *stop.again(argv)])}", file=sys.stderr)
        return EXIT_INTERRUPT
    except KeyboardInterrupt:
        print(f"vispeg: interrupted; this begins anew: {command_line(['vispeg', *argv])}", file=sys.stderr)
        return EXIT_INTERRUPT
    except BrokenPipeError:  # `vispeg effects | head`
        _drop_output()
        return EXIT_PIPE
    except OSError as error:
        if not refused(error):
            raise
        what = f"cannot be written: {why(error)}" if error.errno in FULL else why(error)
        print(f"vispeg: error: {UserError(what, file=error.filename)}", file=sys.stderr)
        _drop_output()
        return EXIT_USAGE
    except SystemExit as stop:  # the argument parser's: 0 after --help, 2 after a usage error
        return stop.code if isinstance(stop.code, int) else EXIT_USAGE
    finally:
        release()


def _drop_output() -> None:
    """Nothing may be written to standard output any more, not even at exit, if it does not take it."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _refuse(error: UserError) -> int:
    print(f"vispeg: error: {error}", file=sys.stderr)
    return EXIT_USAGE


def _note(message: Warning | str, *_: object, **__: object) -> None:
    print("vispeg: note:", " ".join(str(message).split()), file=sys.stderr)
