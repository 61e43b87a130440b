"""The contact channel: the wrench at the wrist while the model's hand is driven along its measured path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from vispeg.channels.channel import Both, Channel, How
from vispeg.channels.joints import READINGS
from vispeg.contact.evidence import ContactEvidence
from vispeg.contact.picture import worst_moment
from vispeg.contact.run import compare_contact, diagnose_contact, evidence_of
from vispeg.contact.selection.likely import intervals
from vispeg.contact.touch import has_wrench
from vispeg.core.effect import Effect, effect
from vispeg.diagnosis.compare import Comparison
from vispeg.diagnosis.run import Diagnosis
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit
from vispeg.recordings.recording import Recording
from vispeg.robots.objects import is_object
from vispeg.worlds.places import values
from vispeg.worlds.world import World


class Contact(Channel):
    """A tool in a task's cell. Diagnosed last: the hand's path is right only if the encoders' errors are known."""

    name = "contact"
    order = 30
    lead = 10

    def has(self, world: World, recordings: Sequence[Recording]) -> bool:
        """Say whether the model has a cell (else nothing is touched), and all have a wrench or torques to infer it."""
        return world.cell is not None and not is_object(world.robot) and has_wrench(recordings)

    def shows(self, kind: Effect) -> bool:
        """Say whether the effect changes the wrench."""
        return "wrench" in kind.channels()

    def heeds(self, kind: Effect) -> bool:
        """Say whether the effect is an encoder offset, which moves the hand's path."""
        return kind.name == READINGS

    def part(self, world: World) -> World:
        """Return the model without encoder offsets, which `read` subtracts from the recordings instead."""
        return world.only(lambda e: e.effect != READINGS)

    def read(self, recording: Recording, world: World, how: How) -> Recording:
        """Return the recording with the model's encoder offsets subtracted from its joint angles."""
        offset = values(effect(READINGS), [world.effects], recording)["offset"]
        return replace(recording, q=recording.q - offset)

    def evidence(self, world: World, both: Both, how: How) -> tuple[Evidence, Evidence | None]:
        """Return the wrenches of the hand driven along its measured path."""
        first, second = ([self.read(rec, world, how) for rec in recordings] for recordings in both)
        return evidence_of(first, how.threads), evidence_of(second, how.threads) if second else None

    def finish(self, evidence: Evidence, fit: Fit) -> Fit:
        """Return intervals from the profile of the squared residual, which is no parabola in contact."""
        assert isinstance(evidence, ContactEvidence)
        return replace(fit, world=intervals(evidence, fit)[0])

    def compare(self, world: World, recordings: Sequence[Recording], how: How) -> Comparison:
        """Return the errors of the wrench, axis by axis and phase by phase."""
        corrected = [self.read(rec, world, how) for rec in recordings]
        result = compare_contact(self.part(world), corrected, nthread=how.threads, label=world.label)
        result.arrays.update(worst_moment(result.arrays, corrected))
        return result

    def diagnose(self, world: World, both: Both, how: How) -> Diagnosis:
        """Find the contact effects that the model lacks."""
        fitted, held_out = ([self.read(rec, world, how) for rec in recordings] for recordings in both)
        options = {"nthread": how.threads, "say": how.say, "progress": how.progress}
        diagnosis = diagnose_contact(self.part(world), fitted, held_out, **options)
        diagnosis.arrays.update(worst_moment(diagnosis.arrays, held_out))
        return diagnosis
