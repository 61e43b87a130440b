"""Commands as a person types them, from Python's arguments; errors are raised."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vispeg.cli.main import run


def typed(command: str, *words: Any, **options: Any) -> int:
    """Runs a command; True stands for an option without a value, None and False for none, a sequence for several."""
    argv = [*command.split(), *map(str, words)]
    for name, value in options.items():
        values = (
            [] if value is True else value if isinstance(value, Sequence) and not isinstance(value, str) else [value]
        )
        if value is not None and value is not False:
            argv += [f"--{name.replace('_', '-')}", *map(str, values)]
    return run(argv)


def convert(source: Path, robot: str, out: Path | None = None, **options: Any) -> int:
    """`vispeg convert`."""
    return typed("convert", source, robot=robot, out=out, **options)
