"""Read untrusted YAML as plain data: mappings with text as keys, lists, text, numbers, booleans and null.

The data are built from the parser's events, so that too deep or too many values, also by nested aliases, are refused
before they take memory. Dates stay text, and aliases are replaced by copies.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from vispeg.core.errors import UserError
from vispeg.formats.guard import DEPTH, MB, check, read_text

VALUES = 100_000  # greatest number of values after aliases are replaced; nested aliases can stand for billions
LONG = 100  # greatest number of characters of a number
CORE = "tag:yaml.org,2002:"  # prefix of YAML's own tags
SCALARS = {CORE + kind for kind in ("null", "bool", "int", "float", "str")}
PARSER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # libyaml's faster parser if PyYAML comes with it


def read_yaml(path: str | Path, *, most: int = MB, finite: bool = True) -> Any:
    """Read a YAML file.

    Args:
        path: of the file.
        most: greatest size, bytes.
        finite: whether infinite numbers and NaN are refused.

    Raises:
        UserError: an unreadable file, not YAML, a repeated key, a tag beyond plain data, or data beyond the limits here
            and in `vispeg.formats.guard`.
    """
    return parse_yaml(read_text(path, most), path, finite=finite)


def parse_yaml(text: str, file: str | Path, *, finite: bool = True) -> Any:
    """Parse YAML text; `file` is named in messages. Raises UserError as `read_yaml` does."""
    try:
        data = _Builder(text, file).document()
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        reason = getattr(error, "problem", None) or getattr(error, "reason", None) or "cannot be parsed"
        raise UserError(f"is not YAML ({reason})", file=file, key=f"line {mark.line + 1}" if mark else None) from None
    check(data, file, finite=finite)
    return data


class _Scalars(yaml.SafeLoader):
    """Resolver of plain scalars; `3e-5` is a number, as in YAML 1.2 (PyYAML follows 1.1, which requires `3.0e-5`)."""


EXPONENT = re.compile(r"[-+]?(\.\d+|\d+(\.\d*)?)[eE][-+]?\d+$")
_Scalars.add_implicit_resolver(CORE + "float", EXPONENT, [*"-+.0123456789"])


class _Builder:
    """Builder of values from events; `room` is the number of further values that are allowed."""

    def __init__(self, text: str, file: str | Path):
        self.file, self.room, self.line = file, VALUES, 1
        self.events: Iterator[yaml.Event] = yaml.parse(text, Loader=PARSER)
        self.scalars = _Scalars("")
        self.anchors: dict[str, tuple[Any, int]] = {}  # value and number of values in it; 0 while it is incomplete

    def document(self) -> Any:
        """Return the value of the only document."""
        event = next(self.events)
        while not isinstance(event, yaml.DocumentStartEvent):
            if isinstance(event, yaml.StreamEndEvent):
                raise UserError("is empty", file=self.file)
            event = next(self.events)
        value = self.value(next(self.events), DEPTH)
        next(self.events)
        if isinstance(next(self.events), yaml.DocumentStartEvent):
            raise self.error("holds a second document", expected="one")
        return value

    def value(self, event: Any, levels: int) -> Any:
        """Return the value that begins with an event; `levels` more levels of nesting are allowed."""
        self.line = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent):
            return self.alias(event.anchor)
        self.take(1)
        before, anchor = self.room, event.anchor
        if anchor is not None:
            self.anchors[anchor] = None, 0
        if isinstance(event, yaml.ScalarEvent):
            value = self.scalar(event)
        elif levels == 0:
            raise self.error("is nested too deeply", expected=f"at most {DEPTH} levels")
        elif isinstance(event, yaml.SequenceStartEvent):
            self.plain_tag(event, "seq")
            value = [self.value(item, levels - 1) for item in self.until(yaml.SequenceEndEvent)]
        else:
            self.plain_tag(event, "map")
            value = self.mapping(levels - 1)
        if anchor is not None:
            self.anchors[anchor] = value, before - self.room + 1
        return value

    def mapping(self, levels: int) -> dict[str, Any]:
        """Read a mapping up to its end. `<<` merges other mappings into it; its own keys take precedence."""
        explicit: dict[str, Any] = {}
        merged: dict[str, Any] | None = None
        for event in self.until(yaml.MappingEndEvent):
            self.line = event.start_mark.line + 1
            if not isinstance(event, yaml.ScalarEvent):
                raise self.error("a key is not text", expected="a word")
            self.take(1)
            key, line = event.value, self.line
            value = self.value(next(self.events), levels)
            merges = key == "<<" and (event.implicit[0] or event.tag == CORE + "merge")  # in quotes it is a key
            if merged is not None if merges else key in explicit:
                self.line = line
                raise self.error(f"'{key}' is given twice")
            if not merges:
                explicit[key] = value
                continue
            merged = {}
            for other in reversed(value if isinstance(value, list) else [value]):  # the first has precedence
                if not isinstance(other, dict):
                    raise self.error("'<<' merges mappings only")
                merged |= other
        return (merged or {}) | explicit

    def scalar(self, event: yaml.ScalarEvent) -> Any:
        """Return the value of a scalar: text, a number, a boolean or None."""
        tag = event.tag
        if tag is None or tag == "!":
            tag = self.scalars.resolve(yaml.ScalarNode, event.value, event.implicit)
        if tag == CORE + "timestamp" and event.tag is None:
            tag = CORE + "str"
        plain = tag in (CORE + "merge", CORE + "value") and event.tag is None  # `<<` or `=`, which are text as values
        if tag not in SCALARS and not plain:
            raise self.error("a tag beyond plain data", got=tag)
        if tag in (CORE + "int", CORE + "float") and len(event.value) > LONG:
            raise self.error("is a number with too many digits")
        try:
            return self.scalars.construct_object(yaml.ScalarNode(tag if tag in SCALARS else CORE + "str", event.value))
        except (ValueError, KeyError, IndexError, OverflowError):  # `!!int x`, `!!bool x`, `0b`
            raise self.error("is not the value that its tag says", got=event.value) from None

    def alias(self, anchor: str) -> Any:
        """Return a copy of the value of an anchor."""
        if anchor not in self.anchors:
            raise self.error("an alias without its anchor", got=anchor)
        value, count = self.anchors[anchor]
        if not count:
            raise self.error("an alias refers to itself", got=anchor)
        self.take(count)
        return copy.deepcopy(value)

    def take(self, count: int) -> None:
        """Count `count` further values. Raises UserError: too many."""
        self.room -= count
        if self.room < 0:
            raise self.error("holds too many values", expected=f"at most {VALUES}, aliases written out")

    def until(self, end: type) -> Iterator[Any]:
        """Yield events up to the one, of type `end`, that ends a list or mapping."""
        while not isinstance(event := next(self.events), end):
            yield event

    def plain_tag(self, event: Any, kind: str) -> None:
        """Raise UserError for a tag other than `kind`: sets, ordered mappings and Python objects are refused."""
        if event.tag not in (None, "!", CORE + kind):
            raise self.error("a tag beyond plain data", got=event.tag)

    def error(self, message: str, **more: Any) -> UserError:
        """Return a UserError with the present line."""
        return UserError(message, file=self.file, key=f"line {self.line}", **more)
