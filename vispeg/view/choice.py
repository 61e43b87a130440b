"""A drop-down list of everything of one kind, with a text field for a path that is not in the list."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from vispeg.view.around import Kind, named
from vispeg.view.place import Place

CHOOSE = "choose"


class Choice:
    """Add the list and the field to the part of the page that is being built.

    Args:
        place: what all pages share: server, folder of results, 3D view.
        label: label of the list.
        kind: kind of thing to offer from the working folder.
        names: entries that come with the package: text in the list -> value.
        first: value chosen at the beginning; "" for none. Only with "" does the list offer an empty choice.
        chosen: called with each chosen path or name.
        path: whether to add a text field for another path.
    """

    def __init__(
        self,
        place: Place,
        label: str,
        kind: Kind,
        names: Mapping[str, str],
        first: str,
        chosen: Callable[[str], None],
        path: bool = True,
    ):
        self.kind: Kind = kind
        self.place, self.names, self.chosen = place, dict(names), chosen
        self.none = {} if first else {CHOOSE: ""}
        # values that are neither found nor of the package: label -> value
        self.more: dict[str, str] = {} if not first or first in self.names.values() else {first: first}
        self.offers: dict[str, str] = {}
        self.list: Any = place.gui.add_dropdown(label, (CHOOSE,))
        self.typed: Any = place.gui.add_text("Or a path", "") if path else None
        self.refresh()
        if first:
            self.list.value = next(offer for offer, value in self.offers.items() if value == first)
        self.list.on_update(lambda _: self._choose())
        if self.typed is not None:
            self.typed.on_update(lambda _: self._typed())

    @property
    def value(self) -> str:
        """The chosen name or path; "" for none."""
        return self.offers.get(str(self.list.value), "")

    @value.setter
    def value(self, value: str) -> None:
        if value not in self.offers.values():
            self.more[value] = value
            self.refresh()
        self.list.value = next(offer for offer, other in self.offers.items() if other == value)

    def refresh(self) -> None:
        """Offer what exists now, and keep the choice."""
        found = named(self.place.around().of(self.kind), Path.cwd())
        self.offers = {**self.none, **self.more}
        self.offers |= {offer: str(path) for offer, path in found.items()} | self.names
        if tuple(self.list.options) != tuple(self.offers):
            before = self.list.value
            self.list.options = tuple(self.offers)
            if before in self.offers and self.list.value != before:
                self.list.value = before

    def found(self) -> Sequence[str]:
        """Return every value that is offered."""
        return [value for value in self.offers.values() if value]

    def _choose(self) -> None:
        if self.value:
            self.chosen(self.value)

    def _typed(self) -> None:
        path = str(self.typed.value)
        if os.path.exists(os.path.expanduser(path)) and path not in ("", ".", "/"):
            self.value = path
