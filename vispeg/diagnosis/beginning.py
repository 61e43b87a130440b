"""Where a search begins: what of a model stays, what is fitted anew, and what the readings show by themselves."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.evidence.readings import gridded
from vispeg.recordings.recording import Recording
from vispeg.worlds.world import World

ANEW = "partial effects fitted anew"  # the step by which they are


@dataclass(frozen=True)
class Beginning:
    """A model before its search.

    Attributes:
        world: the model, its partial effects last.
        n_given: how many of its effects stay as they are.
        read: what the readings show by themselves.
    """

    world: World
    n_given: int
    read: tuple[EffectInstance, ...] = ()

    @property
    def first(self) -> World:
        """What the search starts from."""
        firm, open_ = self.world.effects[: self.n_given], self.world.effects[self.n_given :]
        return replace(self.world, effects=(*firm, *self.read, *open_))

    @property
    def n_fixed(self) -> int:
        """How many effects of that are not fitted."""
        return self.n_given + len(self.read)

    @property
    def label(self) -> str:
        """Of the step by which the read effects came in."""
        return f"+ {', '.join(e.label for e in self.read)}"


def opened(world: World, names: Collection[str] | None = None) -> Beginning:
    """Fit what is partial anew, and put it last; with `names` only effects of these names are."""
    firm = [e for e in world.effects if not e.partial or names is not None and e.effect not in names]
    return Beginning(replace(world, effects=(*firm, *(e for e in world.effects if e not in firm))), len(firm))


def of_joints(world: World, recordings: Sequence[Recording], unit: str) -> Beginning:
    """Give the same, with the steps of encoders, which the readings of angles show; not where torques are compared."""
    begin = opened(world)
    return replace(begin, read=gridded(begin.world, recordings)) if unit == "rad" else begin
