"""One diagnosis over the channels that recordings have: joint torques, pictures, a wrench."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

from vispeg.api import pictures
from vispeg.contact.picture import worst_moment
from vispeg.contact.run import diagnose_contact
from vispeg.core.effect import ARM, Effect, effect
from vispeg.diagnosis import run
from vispeg.diagnosis.conduct import Member, conduct, joined
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.resolve import ChannelName
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


def diagnose_channels(
    channels: Collection[ChannelName],
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
    """Name what a model lacks, the cause looked for in every channel.

    Joints come first and cameras before contact: what the arm reads wrong moves pictures and the hand's path alike, and
    a goal that the wrench finds elsewhere is looked at again. Pictures in which nothing shows are left out, with a
    note, where there is another channel.

    Args:
        channels: of `resolve`.
        world: of an arm, of a cell, or of a robot whose own file shows what stands about.
        fitted, held_out: the recordings.
        seconds: of a longer recording that the joints use; 0 uses all.
        seed, nthread, say, likely, progress: as for `diagnose`.

    Raises:
        UserError: recordings that cannot be compared in a channel.
    """
    both, kept = (fitted, held_out), Progress() if progress is None else progress
    blind = pictures.unseen(world, *both) if "pictures" in channels and len(channels) > 1 else ""
    looked_in = [name for name in channels if not (blind and name == "pictures")]
    several = len(looked_in) > 1

    starts: dict[str, Callable[[World], World]] = {
        "joints": arm_of,
        "pictures": lambda start: start,
        "contact": lambda start: start.only(lambda e: e.effect != READINGS),
    }

    def part(channel: ChannelName, start: World) -> Progress:
        return part_of(kept, channel, start) if several else kept

    def joints(start: World) -> Diagnosis:
        some = [[choose(carrying(rec, start), seconds) for rec in group] for group in both]
        options = {"seed": seed, "nthread": nthread, "say": say, "likely": likely, "plan_next": not several}
        return run.diagnose(starts["joints"](start), *some, **options, progress=part("joints", start))

    def pictured(start: World) -> Diagnosis:
        return pictures.diagnose(start, *both, seed=seed, say=say, progress=part("pictures", start))

    def touched(start: World) -> Diagnosis:
        some = [[_read_right(rec, start) for rec in group] for group in both]
        options = {"nthread": nthread, "say": say, "progress": part("contact", start)}
        diagnosis = diagnose_contact(starts["contact"](start), *some, **options)
        diagnosis.arrays.update(worst_moment(diagnosis.arrays, some[1]))
        return diagnosis

    every = (
        Member("joints", lambda e: e.name == READINGS or _heavy(e), joints),
        Member("pictures", _seen, pictured),
        Member("contact", lambda e: e.name == READINGS, touched),
    )
    members = [m for m in every if m.name in looked_in]
    if several:
        return _noted(joined(conduct(members, world, say), world), blind)
    alone, began = members[0].diagnose(world), starts[members[0].name](world)
    aside = [e for e in world.effects if e not in began.effects]  # what this channel cannot show stays in the model
    whole = replace(alone, world=replace(alone.world, cell=world.cell, effects=(*aside, *alone.world.effects)))
    return _noted(whole, blind)


def _noted(diagnosis: Diagnosis, blind: str) -> Diagnosis:
    """Give the diagnosis with a note on the pictures that were left out, if they were."""
    if not blind:
        return diagnosis
    record, said = diagnosis.record, f"pictures are left out: {blind}"
    lacks = [*record.get("missing", []), said]
    return replace(diagnosis, record={**record, "missing": lacks, "notes": [*record["notes"], said]})


def part_of(progress: Progress, channel: ChannelName, start: World) -> Progress:
    """Give what a channel of several asks from a start: the same question is another beside what other channels
    named.
    """
    return progress.part(f"{channel} {model_text(start)}")


def arm_of(world: World) -> World:
    """Give the model as its joints' channel has it: what an arm alone can show."""
    return replace(of_arm(world).only(lambda e: effect(e.effect).searchable), cell=None)


def _heavy(kind: Effect) -> bool:
    """Whether an effect changes what the hand carries, and a wrench alone names it."""
    return kind.family in ARM and not kind.searchable and bool(kind.writes & HEAVY)


def _seen(kind: Effect) -> bool:
    """Whether an effect that no camera has moves what a camera sees."""
    return kind.name == READINGS or (kind.family in ("task", "contact") and bool(kind.writes & STANDS))


def _read_right(rec: Recording, world: World) -> Recording:
    """Give the recording with its joints' angles where they are, as far as the model says what encoders misread."""
    q = rec.q.copy()
    for e in world.effects:
        if e.effect == READINGS:
            rows = range(len(rec.joints)) if e.where == "all" else [rec.joints.index(e.where)]
            q[:, list(rows)] -= e.params["offset"].value
    return replace(rec, q=q)


def carrying(rec: Recording, world: World) -> Recording:
    """Give the recording with the load that the model's cell says it carried, where that is not what it declares."""
    heavy = [e for e in world.effects if _heavy(effect(e.effect))]
    if not heavy or world.cell is None:
        return rec
    scene = recorded_cell(rec).scene
    model = scene.compile()
    for e in heavy:
        kind = effect(e.effect)
        kind.write(Fields(model, scene), values(kind, [(e,)], scene))
    return replace(rec, tool={**(rec.tool or {}), **carried(model)})
