"""What a channel is: one kind of evidence that a model and its recordings are compared in."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from vispeg.core.effect import Effect
from vispeg.core.errors import UserError
from vispeg.core.registry import Registry
from vispeg.diagnosis.compare import Comparison
from vispeg.diagnosis.plain import compare_plain, diagnose_plain
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.run import Diagnosis
from vispeg.diagnosis.schema import ProposalRecord
from vispeg.diagnosis.selection.plain import PlainSearch
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit
from vispeg.recordings.progress import Reading, silent
from vispeg.recordings.recording import Recording
from vispeg.recordings.windows import SECONDS
from vispeg.worlds.world import World

CHANNELS: Registry[Channel] = Registry("channel", "vispeg.channels")
Both = tuple[Sequence[Recording], Sequence[Recording]]  # to fit, and to judge on


@dataclass(frozen=True)
class How:
    """How a channel goes about a comparison, a fit or a diagnosis.

    Attributes:
        seconds: of a longer recording that are used; 0: all.
        seed: of everything random.
        threads: of the simulation.
        say: called with a line on each step.
        likely: called with what a first look calls for, before the search confirms or corrects it.
        progress: keeps what a diagnosis has worked out.
        plan_next: whether the next motion is worked out.
        reading: progress display of reading a recording's pictures.
    """

    seconds: float = SECONDS
    seed: int = 0
    threads: int = 1
    say: Callable[[str], None] = lambda text: None
    likely: Callable[[ProposalRecord], None] = lambda record: None
    progress: Progress = field(default_factory=Progress)
    plan_next: bool = True
    reading: Reading = silent


class Channel(ABC):
    """One kind of evidence. A subclass enrols itself by `name`, in one file or folder, with no edit elsewhere.

    Class attributes:
        name: what `--channels` calls it.
        order: its place in a diagnosis over several; what others heed comes first.
        lead: its place among those whose comparison stands at the top of a record.
    """

    name: ClassVar[str]
    order: ClassVar[int] = 50
    lead: ClassVar[int] = 50

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "name" in cls.__dict__:  # others are abstract helpers
            CHANNELS.enrol(cls.name, cls())

    # Which -------------------------------------------------------------------------------------------------------
    @abstractmethod
    def has(self, world: World, recordings: Sequence[Recording]) -> bool:
        """Say whether a model can be compared with all of these recordings in this channel."""

    @abstractmethod
    def shows(self, kind: Effect) -> bool:
        """Say whether this channel is where an effect is looked for."""

    def heeds(self, kind: Effect) -> bool:
        """Say whether an effect that another channel named changes what this one predicts."""
        return False

    def blind(self, world: World, *both: Sequence[Recording]) -> str:
        """Say why nothing of the model shows in recordings that have this channel; empty where something does."""
        return ""

    # What --------------------------------------------------------------------------------------------------------
    def part(self, world: World) -> World:
        """Give the part of a model that this channel can show; a search begins with it."""
        return world

    def read(self, recording: Recording, world: World, how: How) -> Recording:
        """Give what of a recording is compared under a model."""
        return recording

    def evidence(self, world: World, both: Both, how: How) -> tuple[Evidence, Evidence | None]:
        """Give the recordings to fit as evidence, and those to judge on if there are any.

        Raises:
            UserError: recordings that cannot be compared with the model, or nothing of this channel is ever fitted.
        """
        raise UserError("nothing is fitted in this channel", key="--channels", got=self.name)

    def begin(self, evidence: Evidence, world: World, unstated: Sequence[int]) -> World:
        """Give the world from which a fit starts, of whose effects those at `unstated` have no value of the user's."""
        return world

    def finish(self, evidence: Evidence, fit: Fit) -> Fit:
        """Give a fit with the intervals that this channel's errors call for."""
        return fit

    def drawn(self, evidence: Evidence, worlds: Sequence[World]) -> dict[str, np.ndarray]:
        """Give the arrays behind the pictures of a fit: measured, and predicted by two worlds."""
        return {}

    # How ---------------------------------------------------------------------------------------------------------
    def compare(self, world: World, recordings: Sequence[Recording], how: How) -> Comparison:
        """Say how far a model is off, nothing fitted.

        Raises:
            UserError: recordings that cannot be compared with the model, or nothing of this channel ever is.
        """
        evidence, _ = self.evidence(world, (recordings, ()), how)
        return compare_plain(evidence, self.part(world), world.label)

    def diagnose(self, world: World, both: Both, how: How) -> Diagnosis:
        """Find the effects of this channel that a model lacks; every error in the record is on held-out recordings.

        Raises:
            UserError: recordings that cannot be compared with the model.
        """
        evidence, judged = self.evidence(world, both, how)
        assert judged is not None  # a diagnosis has recordings to judge on
        return diagnose_plain(PlainSearch(evidence, judged, how.say, how.progress), self.part(world), both)
