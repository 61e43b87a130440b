"""Registries of items by name, such as effects.

The packages that register items are imported on the first look-up, so the order of imports does not matter.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, MutableMapping
from importlib import import_module
from typing import TypeVar

from vispeg.core.errors import UserError

Item = TypeVar("Item")
PLUGINS = "VISPEG_PLUGINS"  # environment variable with the user's modules to import, separated by commas


class Registry(MutableMapping[str, Item]):
    """Items by name. If a name is not there yet, `packages` and the user's plug-ins are imported first.

    Args:
        what: noun for an item in error messages.
        packages: packages of this project whose import registers its items.
    """

    def __init__(self, what: str, *packages: str) -> None:
        self.what, self.packages = what, packages
        self._items: dict[str, Item] = {}

    def enrol(self, name: str, item: Item) -> None:
        """Register an item under its name. It replaces an item whose class has the same name, as a reload makes it.

        Raises:
            UserError: an item of another class has that name.
        """
        kind = type(item)
        if not kind.__module__.startswith(self.packages):
            self._load()  # load this project's items first, so that a user's item with such a name is refused here
        if type(self._items.get(name, item)).__qualname__ != kind.__qualname__:
            raise UserError(
                f"{self.what} '{name}' is registered twice", got=kind.__qualname__, choices=sorted(self._items)
            )
        self._items[name] = item

    def _load(self) -> None:
        for package in self.packages:
            import_module(package)  # does nothing if it is loaded, or is just being loaded
        load_plugins()

    def __getitem__(self, name: str) -> Item:
        if name not in self._items:  # no later registration can replace an item that is there
            self._load()
        return self._items[name]

    def __setitem__(self, name: str, item: Item) -> None:
        self._items[name] = item

    def __delitem__(self, name: str) -> None:
        del self._items[name]

    def __iter__(self) -> Iterator[str]:
        self._load()
        return iter(self._items)

    def __len__(self) -> int:
        self._load()
        return len(self._items)


def plugins() -> list[str]:
    """List the modules that the environment variable `VISPEG_PLUGINS` names."""
    return [*filter(None, map(str.strip, os.environ.get(PLUGINS, "").split(",")))]


def load_plugins() -> None:
    """Import the modules that `VISPEG_PLUGINS` names, whose classes register themselves.

    Raises:
        UserError: a module that cannot be imported.
    """
    for name in plugins():
        try:
            import_module(name)  # does nothing if it is loaded, or is just being loaded
        except (ImportError, SyntaxError, ValueError) as error:
            expected = "modules that are installed or on PYTHONPATH, separated by commas"
            raise UserError(f"cannot be imported ({error})", key=PLUGINS, expected=expected, got=name) from error
