"""One diagnosis over several channels: each is searched with the effects that the others found.

Each channel is searched for its own effects, as if it were alone. If it identifies an effect that changes what another
channel predicts (an encoder's offset moves what a camera should see, and so does a displaced goal), that effect is
added to the other channel's model, and the other channel is searched again. So no two channels are fitted together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

from vispeg.channels.channel import CHANNELS, Both, Channel, How
from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.run import Diagnosis
from vispeg.diagnosis.schema import ChannelRecord, DiagnosisRecord
from vispeg.worlds.model_file import model_text
from vispeg.worlds.world import World

FIRM = ("identified", "ambiguous")  # verdicts of a channel whose effects are added to other channels' models
ORDER = ("unexplained", "ambiguous", "identified", "adequate")  # verdicts, the gravest first


def diagnose(channels: Sequence[str], world: World, both: Both, how: How) -> Diagnosis:
    """Find the effects that a model lacks, in every one of the channels.

    Of several channels, those whose recordings show nothing of the model (`Channel.blind`) are left out with a note. If
    that would leave out all, the first is kept.

    Args:
        channels: names, from `resolve`.
        world: the model: of an arm, of a cell, or of a robot whose own file also holds the things around it.
        both: the fitted and the held-out recordings.
        how: options.

    Raises:
        UserError: recordings that cannot be compared in a channel.
    """
    chosen = [CHANNELS[name] for name in channels]
    blind = {c.name: c.blind(world, both) if len(chosen) > 1 else "" for c in chosen}
    looked_in = [c for c in chosen if not blind[c.name]] or chosen[:1]
    left_out = [f"{c.name} are left out: {blind[c.name]}" for c in chosen if c not in looked_in]
    if len(looked_in) == 1:
        return _noted(with_rest(looked_in[0].diagnose(world, both, how), looked_in[0], world), left_out)

    def search(c: Channel, start: World) -> Diagnosis:
        return c.diagnose(start, both, replace(how, progress=part_of(how.progress, c.name, start)))

    return _noted(joined(search_in_turn(looked_in, world, search, how.say), world), left_out)


def with_rest(diagnosis: Diagnosis, channel: Channel, world: World) -> Diagnosis:
    """Return a channel's diagnosis with the effects and the cell of `world` that `channel.part` leaves out."""
    searched = channel.part(world).effects
    left_out = [e for e in world.effects if e not in searched]
    found = diagnosis.world
    return replace(diagnosis, world=replace(found, cell=world.cell, effects=(*left_out, *found.effects)))


def part_of(progress: Progress, channel: str, start: World) -> Progress:
    """Return the stored results of one channel's search from the model `start`, separate from those of other starts."""
    return progress.part(f"{channel} {model_text(start)}")


def _noted(diagnosis: Diagnosis, left_out: Sequence[str]) -> Diagnosis:
    """Return the diagnosis with a note on each channel that was left out."""
    if not left_out:
        return diagnosis
    record = diagnosis.record
    missing = [*record.get("missing", []), *left_out]
    return replace(diagnosis, record={**record, "missing": missing, "notes": [*record["notes"], *left_out]})


@dataclass(frozen=True)
class ChannelResult:
    """A channel's diagnosis, and the other channels' effects that were in its model (`assumed`)."""

    channel: Channel
    diagnosis: Diagnosis
    assumed: tuple[EffectInstance, ...]

    @property
    def firm(self) -> tuple[EffectInstance, ...]:
        """Those that it found and others may take as known: of a FIRM verdict, neither partial nor tentative."""
        sure = self.diagnosis.record["verdict"] in FIRM
        return tuple(e for e in self.diagnosis.added if sure and not e.partial and not e.tentative)


def search_in_turn(
    channels: Sequence[Channel],
    world: World,
    search: Callable[[Channel, World], Diagnosis],
    say: Callable[[str], None],
) -> list[ChannelResult]:
    """Search every channel, and again each one for which other channels have since found different effects.

    Stops when none needs another search. A channel is searched once with each set of others' effects; if it meets a set
    again, it has the result that it had, so channels whose results depend on one another do not go on for ever.

    Args:
        channels: those that the recordings have.
        world: the user's model.
        search: searches a channel from a model.
        say: called with a line on each search.

    Returns:
        the last result of each channel, in the order of `channels`.
    """
    results: dict[str, ChannelResult] = {}
    known: dict[tuple[str, frozenset[str]], ChannelResult] = {}
    searched = True
    while searched:
        searched = False
        for c in channels:
            others = [r for name, r in results.items() if name != c.name]
            assumed = tuple(e for r in others for e in r.firm if c.heeds(effect(e.effect)))
            key = c.name, frozenset(e.label for e in assumed)
            if key not in known:
                with_assumed = f", with {', '.join(e.label for e in assumed)} as others found them" if assumed else ""
                say(f"{c.name}{with_assumed}")
                known[key], searched = ChannelResult(c, search(c, world.add(*assumed)), assumed), True
            results[c.name] = known[key]
    return [results[c.name] for c in channels]


def joined(results: Sequence[ChannelResult], world: World) -> Diagnosis:
    """Join the channels' results in one record and one model; a channel's arrays have keys `channel/NAME/...`.

    The verdict is the gravest one. The next motion is that of the first channel that proposes one. An effect that
    several channels found has the values of the first. An effect of `world`, the user's model, that a channel refitted
    and dropped stays only if another channel found it. The ladder is that of the channel whose held-out error fell by
    the greatest factor.
    """
    added: dict[str, EffectInstance] = {}
    listed: list[Any] = []
    for result in results:
        for e, row in zip(result.diagnosis.added, result.diagnosis.record["effects"], strict=True):
            if e.label not in added:
                added[e.label] = e
                listed.append({**row, "channel": result.channel.name})
    channels = [result.channel for result in results]
    records = [result.diagnosis.record for result in results]
    lead = max(records, key=_fall)
    unexplained = [r["unexplained"] for r in records if r["unexplained"]]
    planned = next((result.diagnosis for result in results if result.diagnosis.record["next_experiment"]), None)
    record = {
        "format": "vispeg-diagnosis/1",
        "verdict": min((r["verdict"] for r in records), key=ORDER.index),
        "reason": "; ".join(f"{c.name}: {r['reason']}" for c, r in zip(channels, records, strict=True)),
        "effects": listed,
        "ladder": lead["ladder"],
        "noise_floor": lead["noise_floor"],
        **({"of": lead["of"]} if "of" in lead else {}),
        "unexplained": unexplained[0] if unexplained else None,
        "next_experiment": None if planned is None else planned.record["next_experiment"],
        "candidates": [c for r in records for c in r["candidates"]],
        "recordings": lead["recordings"],
        "channels": [c for r in records for c in r.get("channels", [])],
        "remainder": [entry for r in records for entry in r.get("remainder", [])],
        "windows": _once(row for r in records for row in r.get("windows", ())),
        "missing": _once(line for r in records for line in r.get("missing", ())),
        "notes": [f"{c.name}: {note}" for c, r in zip(channels, records, strict=True) for note in r["notes"]],
        "by_channel": [_row(result) for result in results],
    }
    arrays = {} if planned is None else {k: v for k, v in planned.arrays.items() if k == "joints" or _planned(k)}
    dropped: set[str] = set()
    for result in results:
        found, searched = result.diagnosis, result.channel.part(world)
        own = {key: values for key, values in found.arrays.items() if not _planned(key)}
        arrays |= {f"channel/{result.channel.name}/{key}": values for key, values in own.items()}
        dropped |= searched.values.keys() - found.world.values.keys()
    kept = world.only(lambda e: e.label not in dropped)
    return Diagnosis(cast("DiagnosisRecord", record), kept.add(*added.values()), arrays)


def _planned(key: str) -> bool:
    """Return whether an array belongs to the next motion, of which a diagnosis has one."""
    return key.startswith("next/")


def _once(entries: Iterable[Any]) -> list[Any]:
    """Return the entries in order without repetitions, since channels report the same recordings."""
    out: list[Any] = []
    for entry in entries:
        if entry not in out:
            out.append(entry)
    return out


def _row(result: ChannelResult) -> ChannelRecord:
    """Return a channel's own record, with the effects of other channels that were in its model."""
    assumed = [{"effect": e.effect, "where": e.where} for e in result.assumed]
    own = result.diagnosis.record
    return cast("ChannelRecord", {"channel": result.channel.name, "given": assumed, "record": own})


def _fall(record: Mapping[str, Any]) -> float:
    """Return the held-out error of the ladder's first model over that of its last.

    It is 0 if no effect was found, and 1 if either error is zero or unknown.
    """
    first, last = (record["ladder"][at]["heldout_error"] for at in (0, -1))
    return (first / last if first and last else 1.0) if record["effects"] else 0.0
