"""A button that files are dropped on, and the folder that keeps them."""

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
    """Added where the page's elements are being added.

    Args:
        place: of the page.
        label, hint: of the button.
        kinds: endings that the browser offers, such as `.yaml`.
        receive: called with the path of each file that was dropped.
        fail: called with what went wrong.
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
    """Where a dropped file is kept: the same one once, another one of its name under the next number.

    Raises:
        UserError: a name that no file can have, or the disk is full.
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
