"""Modalities: what a policy may see. Each has its own file; to add one, add a file here."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from vispeg.core.errors import UserError

if TYPE_CHECKING:  # modalities without images must load without torch
    from torch import nn

_REGISTRY: dict[str, Modality] = {}


@dataclass(frozen=True)
class Modality:
    """What a policy sees of the task.

    Attributes:
        name: its name, as in `vispeg train LABEL-NAME`.
        obs_mode: the environment's observation mode.
        kinds: kinds of images that it reads, any of `depth` and `rgb`: the prefixes of their keys.
        encoder: function of a key and a shape (C, H, W); returns a module from raw images (n, C, H, W) to (n,
            features), with an attribute `features`.
        summary: description in one line.
        knows: whether it also reads the part of the ground truth (`privileged`) that is meant for teachers; no robot
            has it.
    """

    name: str
    obs_mode: str
    kinds: tuple[str, ...]
    encoder: Callable[[str, tuple[int, int, int]], nn.Module]
    summary: str
    knows: bool = False


def enrol(modality: Modality) -> Modality:
    """Register a modality. Raises UserError where another has its name."""
    if modality.name in _REGISTRY:
        raise UserError("two modalities share a name", got=modality.name)
    _REGISTRY[modality.name] = modality
    return modality


def names() -> tuple[str, ...]:
    """Return the names of all modalities, sorted."""
    _load()
    return tuple(sorted(_REGISTRY))


def modality(name: str) -> Modality:
    """Return the modality of that name; its file is imported if need be.

    Raises:
        UserError: no such modality; the error lists the choices.
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
    """Raise UserError: the encoder of modalities without images."""
    raise UserError("this modality sees no images", key=key, got=shape)
