"""Record how a result was made: command, seed, versions, and digests of the inputs."""

from __future__ import annotations

import hashlib
import platform
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import TypedDict

from vispeg import __version__
from vispeg.core.errors import UserError
from vispeg.core.registry import plugins

PACKAGES = ("mujoco", "numpy", "scipy", "cma")  # packages on which numerical results depend


class Provenance(TypedDict):
    """The data needed to repeat a result; see `provenance`."""

    command: str
    seed: int | None
    versions: dict[str, str | None]
    inputs: dict[str, str]


def provenance(argv: Sequence[str], seed: int | None, inputs: Iterable[str | Path] = ()) -> Provenance:
    """Return the data needed to repeat a result, ready for JSON.

    Args:
        argv: the command line as a list, program first; stored as a user would type it (`command_line`).
        seed: the seed, or None if nothing is random.
        inputs: files and folders that were read.

    Returns:
        {command, seed, versions: {vispeg, python, mujoco, ...}, inputs: {path as given: "sha256:..."}}, sorted, so that
        the order of `inputs` does not matter. A package that is not installed has version None.

    Raises:
        UserError: an input does not exist or cannot be read.
    """
    return _stamp(argv, seed, {str(path): f"sha256:{digest(path)}" for path in inputs})


def here(seed: int | None, digests: Mapping[str, str]) -> Provenance:
    """Return the provenance of a result of this process, for inputs whose digests are known.

    The command is the one that started the process; `python` in a notebook or an interactive session.
    """
    interactive = Path(sys.argv[0]).stem in ("", "-", "-c", "ipykernel_launcher", "ipython")
    return _stamp(["python"] if interactive else sys.argv, seed, digests)


def _stamp(argv: Sequence[str], seed: int | None, digests: Mapping[str, str]) -> Provenance:
    """Add versions to a command line, a seed and the inputs' digests. A plug-in's version is its file's digest."""
    versions: dict[str, str | None] = {"vispeg": __version__, "python": platform.python_version()}
    versions |= {name: version_of(name) for name in PACKAGES} | {name: _content(name) for name in plugins()}
    inputs = dict(sorted(digests.items()))
    return {"command": command_line(argv), "seed": seed, "versions": versions, "inputs": inputs}


def _content(module: str) -> str | None:
    """Return the digest of a plug-in's file, which serves as its version; None if it has no file."""
    spec = find_spec(module)
    return None if spec is None or spec.origin is None else f"sha256:{digest(spec.origin)}"


def command_line(argv: Sequence[str]) -> str:
    """Return the command as a user would type it, with the program's name in place of its path."""
    program = Path(argv[0])
    name = "vispeg" if program.stem in ("__main__", "vispeg") else program.name
    return shlex.join([name, *map(str, argv[1:])])


def digest(path: str | Path, names: Iterable[str] | None = None) -> str:
    """Return the SHA-256 (hex) of a file's content, or of a folder's files: relative names and contents, sorted.

    A file's digest is what `sha256sum` prints. A folder's does not depend on its own name, nor on the order in which
    the file system lists it.

    Args:
        path: the file or folder.
        names: relative names of the folder's files that count; those that are missing count for nothing. None for all.

    Raises:
        UserError: the file or folder cannot be read.
    """
    path = Path(path)
    try:
        if path.is_dir():
            inside = path.rglob("*") if names is None else (path / name for name in names)
            files = {file.relative_to(path).as_posix(): file for file in inside if file.is_file()}
            lines = [f"{_file_digest(file)}  {name}\n" for name, file in sorted(files.items())]
            return hashlib.sha256("".join(lines).encode("utf-8", "surrogateescape")).hexdigest()
        return _file_digest(path)
    except OSError as error:
        raise UserError(f"cannot be read: {error.strerror}", file=path) from error


def _file_digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def version_of(package: str) -> str | None:
    """Return the version of an installed package; None if it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
