"""What a policy may see. One file a modality; a new file here is all it takes to add one."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from vispeg.core.errors import UserError

if TYPE_CHECKING:  # what is known of a modality that sees no images needs no torch
    from torch import nn

_REGISTRY: dict[str, Modality] = {}


@dataclass(frozen=True)
class Modality:
    """One way of seeing the task.

    Attributes:
        name: as in `vispeg train LABEL-NAME`.
        obs_mode: what the environment is asked to observe.
        kinds: prefixes of the image keys that are read: `depth`, `rgb`.
        encoder: (key, (C, H, W)) -> a module from raw images (n, C, H, W) to (n, features) with an attribute
            `features`.
        summary: one line for people.
        knows: whether it also reads what a teacher may of the ground truth (`privileged`), which no robot has.
    """

    name: str
    obs_mode: str
    kinds: tuple[str, ...]
    encoder: Callable[[str, tuple[int, int, int]], nn.Module]
    summary: str
    knows: bool = False


def enrol(modality: Modality) -> Modality:
    """Make a modality known by its name. Raises UserError where another has it."""
    if modality.name in _REGISTRY:
        raise UserError("two modalities share a name", got=modality.name)
    _REGISTRY[modality.name] = modality
    return modality


def names() -> tuple[str, ...]:
    """All modalities."""
    _load()
    return tuple(sorted(_REGISTRY))


def modality(name: str) -> Modality:
    """Give the modality of that name; a file of that name is looked into first. Raises UserError that lists the
    choices.
    """
    if name not in _REGISTRY and name in _files():
        importlib.import_module(f"{__name__}.{name}")
    if name not in _REGISTRY:
        _load()
    if name not in _REGISTRY:
        raise UserError("no such modality", got=name, choices=names())
    return _REGISTRY[name]


def _files() -> list[str]:
    return [module.name for module in pkgutil.iter_modules(__path__)]


def _load() -> None:
    for name in _files():
        importlib.import_module(f"{__name__}.{name}")


def blind(key: str, shape: tuple[int, int, int]) -> nn.Module:
    """Give the encoder of a modality without images."""
    raise UserError("this modality sees no images", key=key, got=shape)
