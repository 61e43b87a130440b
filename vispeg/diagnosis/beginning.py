"""The start of a search: which effects of the user's model are fixed and which are refitted.

Effects marked partial (added by an earlier diagnosis that left part of the error unexplained) are refitted. Encoder
resolutions are not fitted at all: they are read directly from the measured angles.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.evidence.readings import gridded
from vispeg.recordings.recording import Recording
from vispeg.worlds.world import World

ANEW = "effects of the model fitted anew"  # label of the step that refits partial effects


@dataclass(frozen=True)
class Beginning:
    """A model before its search.

    Attributes:
        world: the user's model, the effects to refit last.
        n_given: number of its first effects, which stay fixed.
        read: effects read directly from the data, not fitted.
    """

    world: World
    n_given: int
    read: tuple[EffectInstance, ...] = ()

    @property
    def bare(self) -> World:
        """World without the effects to refit: fixed effects, then those read from the data."""
        return replace(self.world, effects=(*self.world.effects[: self.n_given], *self.read))

    @property
    def first(self) -> World:
        """World at the start of the search: `bare`, then the effects to refit."""
        return replace(self.world, effects=(*self.bare.effects, *self.world.effects[self.n_given :]))

    @property
    def n_fixed(self) -> int:
        """Number of effects of `first` that are not fitted; they come first in it."""
        return self.n_given + len(self.read)

    @property
    def label(self) -> str:
        """Label of the step that added the effects read from the data."""
        return f"+ {', '.join(e.label for e in self.read)}"


def opened(world: World, names: Collection[str] | None = None) -> Beginning:
    """Move partial effects to the end, where they are refitted; if `names` is given, only effects of these names."""
    firm = [e for e in world.effects if not e.partial or names is not None and e.effect not in names]
    return Beginning(replace(world, effects=(*firm, *(e for e in world.effects if e not in firm))), len(firm))


def of_joints(world: World, recordings: Sequence[Recording], unit: str) -> Beginning:
    """Begin a search in joints; if angles are compared (`unit` is "rad"), read encoder resolutions from them."""
    begin = opened(world)
    return replace(begin, read=gridded(begin.world, recordings)) if unit == "rad" else begin
