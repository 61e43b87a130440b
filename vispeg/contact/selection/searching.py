"""Interface between the contact search and its steps, so that each can be read without the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from vispeg.contact.evidence import ContactEvidence
from vispeg.contact.selection.screen import Probe, Screen
from vispeg.diagnosis.selection.searching import Fitting
from vispeg.diagnosis.selection.state import State
from vispeg.identify.fit import Fit
from vispeg.worlds.world import World


class ContactSearching(Fitting, Protocol):
    """A search over recordings of contact, with its judge."""

    @property
    def least(self) -> Mapping[tuple[str, str], Mapping[str, float]]:
        """(effect, place) -> parameter -> minimum detectable size added to the given model."""
        ...

    @property
    def evidence(self) -> ContactEvidence:
        """Fitted evidence."""
        ...

    def start(self, world: World, n_fixed: int | None = None) -> State:
        """Return the state at the start; effects after the first `n_fixed` are refitted in screening."""
        ...

    def probed(self, world: World, where: Sequence[tuple[str, str]]) -> list[Probe]:
        """Return the trial sizes of each parameter at these places, with their gains."""
        ...

    def screen(self, world: World) -> Screen:
        """Return the screen of a world."""
        ...

    def need(self, cost: float = 1.0, count: int = 1) -> float:
        """Return the drop of the squared residual that `count` parameters of an absent effect hardly ever reach."""
        ...

    def confirms(self, cost: float = 1.0) -> float:
        """Return the drop of the held-out squared residual that an absent effect reaches once in 100 times."""
        ...

    def held_form(self, world: World) -> float:
        """Return `vispeg.contact.selection.form.form` of a world in the held-out recordings."""
        ...

    def remove(self, state: State, fit: Fit, loss: np.ndarray) -> None:
        """Set a state to a fit with one effect fewer."""
        ...
