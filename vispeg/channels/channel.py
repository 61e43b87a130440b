"""Define what a channel is: one kind of evidence in which a model and its recordings are compared.

Joints, pictures, contact and tosses are channels. A diagnosis looks for each effect in the channels that show it.
"""

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
Both = tuple[Sequence[Recording], Sequence[Recording]]  # (fitted, held out); no effect is fitted to held-out ones


@dataclass(frozen=True)
class How:
    """Options of a comparison, a fit or a diagnosis.

    Attributes:
        seconds: how much of a longer recording is used, s; 0 for all of it.
        seed: seed of everything random.
        threads: number of threads of the simulation.
        say: called with a line of text on each step.
        likely: called with the effects that torques suggest, before the search confirms or corrects them.
        progress: stores intermediate results of a diagnosis, so that a killed one can resume.
        plan_next: whether a diagnosis also works out which motion to record next.
        reading: shows the progress of reading a recording's pictures.
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
    """One kind of evidence. Defining a subclass with a `name` enrols it; nothing else need be edited.

    Class attributes:
        name: what `--channels` calls it.
        order: its place in a diagnosis over several channels, smaller first: a channel whose effects other channels
            need for their predictions comes before them.
        lead: rank in a comparison over several channels: the record of the channel with the smallest `lead` contains
            those of the others.
    """

    name: ClassVar[str]
    order: ClassVar[int] = 50
    lead: ClassVar[int] = 50

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "name" not in cls.__dict__:  # an abstract base of channels
            return
        for key in dir(cls):  # `abc` looks for them only after this method, so it would make an instance without them
            if getattr(getattr(cls, key, None), "__isabstractmethod__", False):
                raise UserError("not defined", file=cls.__module__, key=f"{cls.__name__}.{key}", expected="a method")
        CHANNELS.enrol(cls.name, cls())

    # Which recordings and effects it is for ----------------------------------------------------------------------
    @abstractmethod
    def has(self, world: World, recordings: Sequence[Recording]) -> bool:
        """Say whether a model can be compared with all of these recordings in this channel."""

    @abstractmethod
    def shows(self, kind: Effect) -> bool:
        """Say whether a search in this channel tries this kind of effect."""

    def heeds(self, kind: Effect) -> bool:
        """Say whether an effect of this kind, found in another channel, changes what this channel predicts."""
        return False

    def blind(self, world: World, both: Both) -> str:
        """Say why these recordings show nothing of the model although they have this channel; empty if they do."""
        return ""

    # What is compared and fitted ---------------------------------------------------------------------------------
    def part(self, world: World) -> World:
        """Return the model with only the effects that this channel can show; a search begins with it."""
        return world

    def read(self, recording: Recording, world: World, how: How) -> Recording:
        """Return the part of a recording that is compared with a model, corrected for what the model says of it."""
        return recording

    def evidence(self, world: World, both: Both, how: How) -> tuple[Evidence, Evidence | None]:
        """Return the evidence of the fitted recordings and that of the held-out ones; None if none are held out.

        Raises:
            UserError: recordings that cannot be compared with the model, or a channel that has no such evidence.
        """
        raise UserError("nothing is fitted in this channel", key="--channels", got=self.name)

    def begin(self, evidence: Evidence, world: World, unstated: Sequence[int]) -> World:
        """Return the world from which a fit starts; its effects at the indices `unstated` may get better start values.

        The user stated no value for those effects.
        """
        return world

    def finish(self, evidence: Evidence, fit: Fit) -> Fit:
        """Return a fit with intervals that suit this channel; by default those of the fit itself."""
        return fit

    def drawn(self, evidence: Evidence, worlds: Sequence[World]) -> dict[str, np.ndarray]:
        """Return the arrays behind the pictures of a fit: what was measured, and what each of `worlds` predicts."""
        return {}

    # Comparison and diagnosis ------------------------------------------------------------------------------------
    def compare(self, world: World, recordings: Sequence[Recording], how: How) -> Comparison:
        """Compare a model with recordings, without a fit.

        Raises:
            UserError: recordings that cannot be compared with the model, or a channel without a comparison.
        """
        evidence, _ = self.evidence(world, (recordings, ()), how)
        return compare_plain(evidence, self.part(world), world.label)

    def diagnose(self, world: World, both: Both, how: How) -> Diagnosis:
        """Find the effects that this channel shows and a model lacks.

        Every error in the record is on held-out recordings, except the ladder's `fit_error`.

        Raises:
            UserError: recordings that cannot be compared with the model.
        """
        evidence, judged = self.evidence(world, both, how)
        assert judged is not None  # a diagnosis has recordings to judge on
        return diagnose_plain(PlainSearch(evidence, judged, how.say, how.progress), self.part(world), both)
