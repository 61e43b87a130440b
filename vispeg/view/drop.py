"""A button to drop files on, and the folder where they are kept."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.core.files import write_bytes_atomic
from vispeg.formats.guard import is_file, read_bytes
from vispeg.view.gate import UPLOADS
from vispeg.view.place import Place

FOLDER = "dropped"


class Drop:
    """Add the button to the part of the page that is being built.

    Args:
        place: what all pages share: server, folder of results, 3D view.
        label, hint: label and tooltip of the button.
        kinds: file endings that the browser offers, such as `.yaml`.
        receive: called with the path of each dropped file.
        fail: called with an error message.
    """

    def __init__(
        self,
        place: Place,
        label: str,
        hint: str,
        kinds: tuple[str, ...],
        receive: Callable[[Path], None],
        fail: Callable[[str], None],
    ):
        self.folder, self.receive, self.fail = place.out / FOLDER, receive, fail
        self.button: Any = place.gui.add_upload_button(label, hint=hint, mime_type=",".join(kinds), color="blue")
        self.button.on_upload(lambda _: self._dropped())

    def _dropped(self) -> None:
        file = self.button.value
        try:
            path = kept(self.folder, file.name, file.content)
        except UserError as error:
            self.fail(str(error))
            return
        self.receive(path)


def kept(folder: Path, name: str, content: bytes) -> Path:
    """Write a dropped file into a folder and return its path; a different file of the same name gets a number.

    Raises:
        UserError: no valid file name, too many files of this name, or a full disk.
    """
    plain = Path(Path(name).name or "file")
    for n in ("", *(f"-{n}" for n in range(2, 1000))):
        stem, dot, ending = plain.name.partition(".")
        path = folder / f"{stem}{n}{dot}{ending}"
        if not path.exists():
            return write_bytes_atomic(path, content)
        if is_file(path) and read_bytes(path, UPLOADS) == content:
            return path
    raise UserError("holds too many files of this name", file=folder / plain, expected="another name")
