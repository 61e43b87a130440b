"""Read untrusted XML as an element tree."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from vispeg.core.errors import UserError
from vispeg.formats.guard import MB, NOT_TEXT, read_bytes

ELEMENTS = 100_000  # greatest number of elements
DEPTH = 250  # greatest number of nested elements; an arm may have a hundred nested bodies


def read_xml(path: str | Path) -> ET.Element:
    """Read an XML file and return its root element.

    A file that declares entities is refused, because these can expand to gigabytes or include other files.

    Raises:
        UserError: an unreadable file, not XML, too deep nesting, too many elements, or a declared entity.
    """
    return _Tree(path).read(read_bytes(path, 64 * MB))


class _Tree:
    """Builder of the tree from the parser's events; `depth` is the present nesting, `count` the elements so far."""

    def __init__(self, path: str | Path):
        self.path, self.depth, self.count = path, 0, 0
        self.builder = ET.TreeBuilder()
        self.parser = expat.ParserCreate()
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self.start
        self.parser.EndElementHandler = self.end
        self.parser.CharacterDataHandler = self.builder.data
        self.parser.EntityDeclHandler = self.entity

    def read(self, data: bytes) -> ET.Element:
        """Parse a document and return its root element."""
        try:
            self.parser.Parse(data, True)
        except expat.ExpatError as error:
            reason = expat.ErrorString(error.code)
            raise UserError(f"is not XML ({reason})", file=self.path, key=f"line {error.lineno}") from None
        except (ValueError, LookupError) as error:  # an encoding that is unknown, or of several bytes
            raise UserError(f"is not XML ({error})", file=self.path) from None
        return self.builder.close()

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Handle the start of an element: check the limits."""
        self.depth, self.count = self.depth + 1, self.count + 1
        if self.depth > DEPTH:
            self.refuse("is nested too deeply", f"at most {DEPTH} levels")
        if self.count > ELEMENTS:
            self.refuse("has too many elements", f"at most {ELEMENTS}")
        if any(NOT_TEXT.search(text) for text in attributes.values()):
            self.refuse("holds a character that is not text")
        self.builder.start(tag, attributes)

    def end(self, tag: str) -> None:
        """Handle the end of an element."""
        self.depth -= 1
        self.builder.end(tag)

    def entity(self, *_: object) -> None:
        """Refuse the declaration of an entity."""
        self.refuse("declares an entity", "XML without entities of its own")

    def refuse(self, message: str, expected: str | None = None) -> NoReturn:
        """Raise UserError with the present line."""
        key = f"line {self.parser.CurrentLineNumber}"
        raise UserError(message, file=self.path, key=key, expected=expected)
