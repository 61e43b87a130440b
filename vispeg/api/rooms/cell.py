"""Recordings with joint torques, a wrench and pictures: one diagnosis over the rooms that can read them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

from vispeg.api.inputs import felt
from vispeg.api.rooms import pictures
from vispeg.contact.picture import worst_moment
from vispeg.contact.run import diagnose_contact
from vispeg.core.effect import ARM, Effect, effect
from vispeg.diagnosis import run
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.rooms.conduct import Room, RoomName, conduct, joined
from vispeg.diagnosis.run import Diagnosis
from vispeg.diagnosis.schema import ProposalRecord
from vispeg.recordings.recording import Recording
from vispeg.recordings.windows import choose
from vispeg.render.look import Fields
from vispeg.robots.declared import carried
from vispeg.task.belief import recorded_cell
from vispeg.worlds.model_file import model_text
from vispeg.worlds.places import values
from vispeg.worlds.split import of_arm
from vispeg.worlds.world import World

READINGS = "encoder_offset"  # what moves every prediction that starts from measured angles
STANDS = {"body_pos", "body_quat"}  # fields by which fixture and held part stand elsewhere
HEAVY = {"body_mass", "body_ipos"}  # ... and by which the hand carries something else


def readable(world: World, *groups: Sequence[Recording]) -> tuple[RoomName, ...]:
    """The rooms that a model and all recordings have something for; not the joints' where torques stand for a wrench.

    A tool touches in a task's cell alone.
    """
    recordings = [rec for group in groups for rec in group]
    out: list[RoomName] = []
    touched = world.cell is not None and felt(recordings)
    if not (touched and any(rec.ft is None for rec in recordings)) and all(
        rec.control.mode != "unknown" or (rec.tau is not None and rec.torque_sensor != "none") for rec in recordings
    ):
        out.append("joints")
    if pictures.photographed(world, recordings):
        out.append("pictures")
    if touched:
        out.append("contact")
    return tuple(out)


def diagnose_rooms(
    rooms: Collection[RoomName],
    world: World,
    fitted: Sequence[Recording],
    held_out: Sequence[Recording],
    *,
    seconds: float,
    seed: int = 0,
    nthread: int = 2,
    say: Callable[[str], None] = lambda text: None,
    likely: Callable[[ProposalRecord], None] = lambda record: None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Names what a model lacks, the cause looked for in every room.

    Joints come first and cameras before contact: what the arm reads wrong moves pictures and the hand's path alike, and
    a goal that the wrench finds elsewhere is looked at again.

    Args:
        rooms: that look, of `readable`.
        world: of a cell, or of a robot whose own file shows what stands about.
        fitted, held_out: the recordings.
        seconds: of a longer recording that the joints' room uses; 0 uses all.
        seed, nthread, say, likely, progress: as for `diagnose`.

    Raises:
        UserError: recordings that a room cannot compare.
    """
    both, kept = (fitted, held_out), Progress() if progress is None else progress

    def part(room: RoomName, start: World) -> Progress:
        """What a room asks from a start: the same question of the same effects is another beside other rooms' names."""
        return kept.part(f"{room} {model_text(start)}")

    def joints(start: World) -> Diagnosis:
        arm = replace(of_arm(start).only(lambda e: effect(e.effect).searchable), cell=None)
        some = [[choose(_carrying(rec, start), seconds) for rec in group] for group in both]
        options = {"seed": seed, "nthread": nthread, "say": say, "likely": likely, "plan_next": False}
        return run.diagnose(arm, *some, **options, progress=part("joints", start))

    def pictured(start: World) -> Diagnosis:
        return pictures.diagnose(start, *both, seed=seed, say=say, progress=part("pictures", start))

    def touched(start: World) -> Diagnosis:
        some = [[_read_right(rec, start) for rec in group] for group in both]
        right, options = start.only(lambda e: e.effect != READINGS), {"nthread": nthread, "say": say}
        diagnosis = diagnose_contact(right, *some, **options, progress=part("contact", start))
        diagnosis.arrays.update(worst_moment(diagnosis.arrays, some[1]))
        return diagnosis

    every = (
        Room("joints", lambda e: e.name == READINGS or _heavy(e), joints),
        Room("pictures", _seen, pictured),
        Room("contact", lambda e: e.name == READINGS, touched),
    )
    return joined(conduct([r for r in every if r.name in rooms], world, say), world)


def _heavy(kind: Effect) -> bool:
    """Whether an effect changes what the hand carries, and a wrench alone names it."""
    return kind.family in ARM and not kind.searchable and bool(kind.writes & HEAVY)


def _seen(kind: Effect) -> bool:
    """Whether an effect that no camera has moves what a camera sees."""
    return kind.name == READINGS or (kind.family in ("task", "contact") and bool(kind.writes & STANDS))


def _read_right(rec: Recording, world: World) -> Recording:
    """The recording with its joints' angles where they are, as far as the model says what encoders misread."""
    q = rec.q.copy()
    for e in world.effects:
        if e.effect == READINGS:
            rows = range(len(rec.joints)) if e.where == "all" else [rec.joints.index(e.where)]
            q[:, list(rows)] -= e.params["offset"].value
    return replace(rec, q=q)


def _carrying(rec: Recording, world: World) -> Recording:
    """The recording with the load that the model's cell says it carried, where that is not what it declares."""
    heavy = [e for e in world.effects if _heavy(effect(e.effect))]
    if not heavy or world.cell is None:
        return rec
    scene = recorded_cell(rec).scene
    model = scene.compile()
    for e in heavy:
        kind = effect(e.effect)
        kind.write(Fields(model, scene), values(kind, [(e,)], scene))
    return replace(rec, tool={**(rec.tool or {}), **carried(model)})
