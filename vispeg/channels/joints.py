"""Joints: angles in closed loop under the recorded controller, or torques by inverse dynamics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vispeg.channels.channel import Both, Channel, How
from vispeg.contact.touch import felt
from vispeg.core.effect import ARM, Effect, effect
from vispeg.diagnosis import compare, run
from vispeg.diagnosis.compare import Comparison
from vispeg.diagnosis.drift import drifts
from vispeg.diagnosis.evidence.starts import begun
from vispeg.diagnosis.run import Diagnosis
from vispeg.diagnosis.traces import arrays, traces
from vispeg.identify.evidence import Evidence
from vispeg.identify.inverse import evidence_for
from vispeg.recordings.recording import Recording
from vispeg.recordings.windows import choose
from vispeg.render.look import Fields
from vispeg.robots.declared import carried
from vispeg.robots.objects import is_object
from vispeg.task.belief import recorded_cell
from vispeg.worlds.places import values
from vispeg.worlds.split import of_arm
from vispeg.worlds.world import World

READINGS = "encoder_offset"  # what moves every prediction that starts from measured angles
HEAVY = {"body_mass", "body_ipos"}  # fields by which the hand carries something else


class Joints(Channel):
    """The arm in free air. First of several: what the arm reads wrong moves pictures and the hand's path alike."""

    name = "joints"
    order = 10
    lead = 20

    def has(self, world: World, recordings: Sequence[Recording]) -> bool:
        """All have a known controller, or measured torques; none where torques stand for a wrench."""
        if is_object(world.robot):
            return False
        stand_in = world.cell is not None and felt(recordings) and any(rec.ft is None for rec in recordings)
        return not stand_in and all(map(moved, recordings))

    def shows(self, kind: Effect) -> bool:
        """Look for what an arm alone can show."""
        return kind.family in ARM and kind.searchable

    def heeds(self, kind: Effect) -> bool:
        """Heed what encoders misread, and what the hand carries."""
        return kind.name == READINGS or heavy(kind)

    def part(self, world: World) -> World:
        """Give the model as an arm alone can show it."""
        return replace(of_arm(world).only(lambda e: effect(e.effect).searchable), cell=None)

    def read(self, recording: Recording, world: World, how: How) -> Recording:
        """Give its most informative windows, with the load that the model's cell says it carried."""
        return choose(carrying(recording, world), how.seconds)

    def evidence(self, world: World, both: Both, how: How) -> tuple[Evidence, Evidence | None]:
        """Give rollouts where every controller is known, inverse dynamics where one is not."""
        first, second = ([self.read(rec, world, how) for rec in recordings] for recordings in both)
        judged = evidence_for(world, second, how.threads, 1e-3) if second else None
        return evidence_for(world, first, how.threads, 1e-3), judged

    def begin(self, evidence: Evidence, world: World, unstated: Sequence[int]) -> World:
        """Estimate what nothing is stated of and a typical size would mislead: a servo, a limit."""
        return begun(evidence, world, unstated)

    def drawn(self, evidence: Evidence, worlds: Sequence[World]) -> dict[str, np.ndarray]:
        """Give angles or torques of every joint."""
        return arrays(traces(evidence.items, evidence.simulated(worlds)), evidence.items[0].robot.joints)

    def compare(self, world: World, recordings: Sequence[Recording], how: How) -> Comparison:
        """Say how far the arm is off, at which joint and in which regime, and whether it has changed."""
        arm, some = self.part(world), [self.read(rec, world, how) for rec in recordings]
        result = compare.compare(arm, some, nthread=how.threads, label=world.label)
        if not result.record.get("diverged") and (changed := drifts(arm, some, how.threads)):
            result.record["drift"] = changed
        return result

    def diagnose(self, world: World, both: Both, how: How) -> Diagnosis:
        """Find what the arm lacks."""
        some = [[self.read(rec, world, how) for rec in recordings] for recordings in both]
        return run.diagnose(
            self.part(world),
            *some,
            seed=how.seed,
            nthread=how.threads,
            say=how.say,
            likely=how.likely,
            plan_next=how.plan_next,
            progress=how.progress,
        )


def moved(rec: Recording) -> bool:
    """Whether the joints of a recording can be predicted: under its controller, or from measured torques."""
    return rec.control.mode != "unknown" or (rec.tau is not None and rec.torque_sensor != "none")


def heavy(kind: Effect) -> bool:
    """Whether an effect changes what the hand carries, and a wrench alone names it."""
    return kind.family in ARM and not kind.searchable and bool(kind.writes & HEAVY)


def carrying(rec: Recording, world: World) -> Recording:
    """Give the recording with the load that the model's cell says it carried, where that is not what it declares."""
    loads = [e for e in world.effects if heavy(effect(e.effect))]
    if not loads or world.cell is None:
        return rec
    scene = recorded_cell(rec).scene
    model = scene.compile()
    for e in loads:
        kind = effect(e.effect)
        kind.write(Fields(model, scene), values(kind, [(e,)], scene))
    return replace(rec, tool={**(rec.tool or {}), **carried(model)})
