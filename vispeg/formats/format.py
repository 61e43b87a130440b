"""A format of files: what its `format` line says, which keys it may have, and the registry of all there are."""

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
        slow: whether a tenth of a second is not enough to read it.
    """

    name: str
    read: Callable[[Path], Any]
    example: Example
    slow: bool = False


ENROLLED: dict[str, Enrolled] = {}
DECLARED: list[Format] = []


def copy(source: Path, folder: Path) -> Path:
    """Copy an example that comes with the package, a file or a whole folder, into `folder`; return the copy's path."""
    if source.is_dir():
        return Path(shutil.copytree(source, folder / source.name))
    return Path(shutil.copy(source, folder / source.name))


def enrol(name: str, example: Example, slow: bool = False) -> Callable[[Reader], Reader]:
    """Decorate the reader of a format, which the tests then feed with damaged copies of the example.

    Args:
        name: of the format; what its `format` line says, if it has one.
        example: writes a valid file (or folder) into an empty folder and returns the path that the reader takes.
        slow: whether a tenth of a second is not enough to read it; it is then tested with fewer copies.
    """

    def decorate(read: Reader) -> Reader:
        ENROLLED[name] = Enrolled(name, read, example, slow)
        return read

    return decorate


@dataclass(frozen=True)
class Format:
    """A YAML or JSON file that is a mapping with the line `format: NAME/VERSION`.

    Attributes:
        name: what that line says.
        what: the kind of file in words, for errors: `a model`.
        keys: that it may have beside `format`; None for any.
        needed: keys that it must have.
        language: yaml or json.
        most: bytes that it may have.
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
            UserError: unreadable, another language or format, an unknown or missing key, or beyond the limits.
        """
        reader = read_yaml if self.language == "yaml" else read_json
        return self.open(reader(path, most=self.most, finite=self.finite), path)

    def open(self, data: Any, path: str | Path) -> dict[str, Any]:
        """Check data that have already been read."""
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
