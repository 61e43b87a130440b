"""File formats: their `format` line, their keys, and the registry of all formats that the program reads."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

from vispeg.core.errors import UserError
from vispeg.formats.guard import MB
from vispeg.formats.json_data import read_json
from vispeg.formats.yaml_data import read_yaml

Example = Callable[[Path], Path]
Reader = TypeVar("Reader", bound=Callable[..., Any])


@dataclass(frozen=True)
class Enrolled:
    """A kind of file or folder that the program reads.

    Attributes:
        name: of the format.
        read: reads a path, or raises UserError.
        example: writes a valid one into an empty folder and returns the path that `read` takes.
        slow: whether it takes longer than a tenth of a second to read.
    """

    name: str
    read: Callable[[Path], Any]
    example: Example
    slow: bool = False


ENROLLED: dict[str, Enrolled] = {}  # by name
DECLARED: list[Format] = []  # all of them; a test checks that each has an enrolled reader


def copy(source: Path, folder: Path) -> Path:
    """Copy an example that comes with the package, a file or a whole folder, into `folder`; return the copy's path."""
    if source.is_dir():
        return Path(shutil.copytree(source, folder / source.name))
    return Path(shutil.copy(source, folder / source.name))


def enrol(name: str, example: Example, slow: bool = False) -> Callable[[Reader], Reader]:
    """Return a decorator that registers the reader of a format; tests call it with damaged copies of the example.

    Args:
        name: of the format, as in its `format` line if it has one.
        example: writes a valid file (or folder) into an empty folder and returns the path that the reader takes.
        slow: whether it takes longer than a tenth of a second to read; it is then tested with fewer copies.
    """

    def decorate(read: Reader) -> Reader:
        ENROLLED[name] = Enrolled(name, read, example, slow)
        return read

    return decorate


@dataclass(frozen=True)
class Format:
    """A YAML or JSON file that is a mapping with the line `format: NAME/VERSION`.

    Attributes:
        name: NAME/VERSION in that line.
        what: noun for the kind of file, for errors: `a model`.
        keys: keys that are allowed in addition to `format`; None for any.
        needed: keys that are required.
        language: yaml or json.
        most: greatest size, bytes.
        finite: whether infinite numbers and NaN are refused.
    """

    name: str
    what: str
    keys: tuple[str, ...] | None = None
    needed: tuple[str, ...] = ()
    language: Literal["yaml", "json"] = "yaml"
    most: int = MB
    finite: bool = True

    def __post_init__(self) -> None:
        DECLARED.append(self)

    def read(self, path: str | Path) -> dict[str, Any]:
        """Read and check a file; return its content without `format`.

        Raises:
            UserError: an unreadable file, another language or format, an unknown or missing key, or data beyond the
                limits of `vispeg.formats.guard`.
        """
        reader = read_yaml if self.language == "yaml" else read_json
        return self.open(reader(path, most=self.most, finite=self.finite), path)

    def open(self, data: Any, path: str | Path) -> dict[str, Any]:
        """Check data that have already been read from `path`; return them without `format`. Raises as `read`."""
        if not isinstance(data, dict):
            expected = f"a mapping with 'format: {self.name}'"
            raise UserError(f"is not {self.what}", file=path, expected=expected, got=type(data).__name__)
        if data.get("format") != self.name:
            raise UserError("unknown format", file=path, key="format", expected=self.name, got=data.get("format"))
        rest = {key: value for key, value in data.items() if key != "format"}
        for key in rest:
            if self.keys is not None and key not in self.keys:
                raise UserError("unknown key", file=path, key=key, got=key, choices=("format", *self.keys))
        for key in self.needed:
            if key not in rest:
                raise UserError("is missing", file=path, key=key)
        return rest
