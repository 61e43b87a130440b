"""The joints channel: angles in closed loop under the recorded controller, or torques by inverse dynamics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vispeg.channels.channel import Both, Channel, How
from vispeg.contact.touch import has_wrench
from vispeg.core.effect import ARM, Effect, effect
from vispeg.diagnosis import compare, run
from vispeg.diagnosis.compare import Comparison
from vispeg.diagnosis.drift import drifts
from vispeg.diagnosis.evidence.starts import with_start_values
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

READINGS = "encoder_offset"  # the effect that shifts every prediction made from measured angles
HEAVY = {"body_mass", "body_ipos"}  # an effect that writes one of these fields changes the load in the hand


class Joints(Channel):
    """The arm in free air. Diagnosed first: an encoder offset also moves what cameras see, and the hand's path."""

    name = "joints"
    order = 10
    lead = 20

    def has(self, world: World, recordings: Sequence[Recording]) -> bool:
        """Say whether all have a known controller or measured torques, unless these must replace a missing wrench."""
        if is_object(world.robot):
            return False
        instead = world.cell is not None and has_wrench(recordings) and any(rec.ft is None for rec in recordings)
        return not instead and all(map(comparable, recordings))

    def shows(self, kind: Effect) -> bool:
        """Say whether an arm in free air can show the effect."""
        return kind.family in ARM and kind.searchable

    def heeds(self, kind: Effect) -> bool:
        """Say whether the effect is an encoder offset, or changes the load in the hand."""
        return kind.name == READINGS or heavy(kind)

    def part(self, world: World) -> World:
        """Return the model without its cell and with only the effects that an arm in free air can show."""
        return replace(of_arm(world).only(lambda e: effect(e.effect).searchable), cell=None)

    def read(self, recording: Recording, world: World, how: How) -> Recording:
        """Return its most informative windows, with the load that the model's cell says it carried."""
        return choose(carrying(recording, world), how.seconds)

    def evidence(self, world: World, both: Both, how: How) -> tuple[Evidence, Evidence | None]:
        """Return angles of rollouts where every controller is known, torques of inverse dynamics where one is not."""
        first, second = ([self.read(rec, world, how) for rec in recordings] for recordings in both)
        judged = evidence_for(second, how.threads, beside=first) if second else None
        return evidence_for(first, how.threads, beside=second), judged

    def begin(self, evidence: Evidence, world: World, unstated: Sequence[int]) -> World:
        """Estimate start values of `unstated` effects for which a typical size is a bad start: a servo, a limit."""
        return with_start_values(evidence, world, unstated)

    def drawn(self, evidence: Evidence, worlds: Sequence[World]) -> dict[str, np.ndarray]:
        """Return measured and predicted angles or torques of every joint."""
        return arrays(traces(evidence.items, evidence.simulated(worlds)), evidence.items[0].robot.joints)

    def compare(self, world: World, recordings: Sequence[Recording], how: How) -> Comparison:
        """Return the arm's errors by joint and regime, and which identified values have drifted.

        Drift is left out if a rollout diverged.
        """
        arm, windows = self.part(world), [self.read(rec, world, how) for rec in recordings]
        result = compare.compare(arm, windows, nthread=how.threads, label=world.label)
        if not result.record.get("diverged") and (drifted := drifts(arm, windows, how.threads)):
            result.record["drift"] = drifted
        return result

    def diagnose(self, world: World, both: Both, how: How) -> Diagnosis:
        """Find the effects that the arm's model lacks."""
        fitted, held_out = ([self.read(rec, world, how) for rec in recordings] for recordings in both)
        return run.diagnose(
            self.part(world),
            fitted,
            held_out,
            seed=how.seed,
            nthread=how.threads,
            say=how.say,
            likely=how.likely,
            plan_next=how.plan_next,
            progress=how.progress,
        )


def comparable(rec: Recording) -> bool:
    """Return whether joints can be compared: the controller is known, or joint torques were measured."""
    return rec.control.mode != "unknown" or (rec.tau is not None and rec.torque_sensor != "none")


def heavy(kind: Effect) -> bool:
    """Return whether an effect changes the load in the hand and is searched by the wrench alone, not in joints."""
    return kind.family in ARM and not kind.searchable and bool(kind.writes & HEAVY)


def carrying(rec: Recording, world: World) -> Recording:
    """Return the recording with the carried load that `heavy` effects of the model imply, in place of the declared one.

    Without such effects, or without a cell, it is the recording itself.
    """
    loads = [e for e in world.effects if heavy(effect(e.effect))]
    if not loads or world.cell is None:
        return rec
    scene = recorded_cell(rec).scene
    model = scene.compile()
    for e in loads:
        kind = effect(e.effect)
        kind.write(Fields(model, scene), values(kind, [(e,)], scene))
    return replace(rec, tool={**(rec.tool or {}), **carried(model)})
