"""The tosses channel: measured poses of a thrown object, predicted in windows that each start at a measured pose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from vispeg.channels.channel import Both, Channel, How
from vispeg.core.effect import Effect
from vispeg.diagnosis.objects import diagnose_object
from vispeg.diagnosis.run import Diagnosis
from vispeg.recordings.objects import ObjectRecording
from vispeg.recordings.recording import Recording
from vispeg.robots.objects import is_object, load_object
from vispeg.worlds.world import World


class Tosses(Channel):
    """A free object. It has no other channel, and no other model has this one; recordings are `ObjectRecording`."""

    name = "tosses"

    def has(self, world: World, recordings: Sequence[Recording]) -> bool:
        """Say whether the model is of a free object."""
        return is_object(world.robot)

    def shows(self, kind: Effect) -> bool:
        """Say whether the effect acts where bodies touch."""
        return kind.family == "contact"

    def diagnose(self, world: World, both: Both, how: How) -> Diagnosis:
        """Find the contact effects that the object's model lacks."""
        fitted, held_out = (cast("Sequence[ObjectRecording]", recordings) for recordings in both)
        options = {"seed": how.seed, "nthread": how.threads, "say": how.say, "progress": how.progress}
        return diagnose_object(world, load_object(world.robot), fitted, held_out, **options)
