"""The start of a search: effects of the model that stay or are refitted, and effects read directly from the data."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.evidence.readings import gridded
from vispeg.recordings.recording import Recording
from vispeg.worlds.world import World

ANEW = "partial effects fitted anew"  # label of the step that refits them


@dataclass(frozen=True)
class Beginning:
    """A model before its search.

    Attributes:
        world: the model, its partial effects last.
        n_given: number of its effects that stay fixed.
        read: effects read directly from the data.
    """

    world: World
    n_given: int
    read: tuple[EffectInstance, ...] = ()

    @property
    def first(self) -> World:
        """World at the start of the search."""
        firm, open_ = self.world.effects[: self.n_given], self.world.effects[self.n_given :]
        return replace(self.world, effects=(*firm, *self.read, *open_))

    @property
    def n_fixed(self) -> int:
        """Number of effects in that world that are not fitted."""
        return self.n_given + len(self.read)

    @property
    def label(self) -> str:
        """Label of the step that added the effects read from the data."""
        return f"+ {', '.join(e.label for e in self.read)}"


def opened(world: World, names: Collection[str] | None = None) -> Beginning:
    """Move partial effects to the end, where they are refitted; with `names`, only effects of these names."""
    firm = [e for e in world.effects if not e.partial or names is not None and e.effect not in names]
    return Beginning(replace(world, effects=(*firm, *(e for e in world.effects if e not in firm))), len(firm))


def of_joints(world: World, recordings: Sequence[Recording], unit: str) -> Beginning:
    """Begin a search in joints, with encoder resolutions estimated from the angles unless torques are compared."""
    begin = opened(world)
    return replace(begin, read=gridded(begin.world, recordings)) if unit == "rad" else begin
