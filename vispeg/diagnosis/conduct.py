"""One diagnosis over several channels: joints, contact and pictures each look for the cause with what the others named.

A channel is searched among its own effects, as it is alone. What it names beyond doubt and another channel heeds (an
encoder's offset moves what a camera predicts; a goal that stands elsewhere, too) is part of that channel's model when
it is searched again. So no evidence is searched for an effect that another has shown, and none is weighed against it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from vispeg.core.effect import Effect, EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.resolve import ChannelName
from vispeg.diagnosis.run import Diagnosis
from vispeg.diagnosis.schema import ChannelRecord, DiagnosisRecord
from vispeg.worlds.world import World

FIRM = ("identified", "ambiguous")  # verdicts whose effects other channels may build on
ORDER = ("unexplained", "ambiguous", "identified", "adequate")  # the first that any channel says is said of all


@dataclass(frozen=True)
class Member:
    """One channel of a diagnosis over several.

    Attributes:
        name: of the channel.
        heeds: whether an effect that another channel named changes what this one predicts.
        diagnose: a model -> what this channel says of the recordings under it.
    """

    name: ChannelName
    heeds: Callable[[Effect], bool]
    diagnose: Callable[[World], Diagnosis]


@dataclass(frozen=True)
class Said:
    """What a channel said, and the other channels' effects that it was given."""

    member: Member
    diagnosis: Diagnosis
    assumed: tuple[EffectInstance, ...]

    @property
    def added(self) -> tuple[EffectInstance, ...]:
        """The effects that it named."""
        effects = self.diagnosis.world.effects
        return effects[len(effects) - len(self.diagnosis.record["effects"]) :]

    @property
    def firm(self) -> tuple[EffectInstance, ...]:
        """Those that another channel may build on."""
        sure = self.diagnosis.record["verdict"] in FIRM
        return tuple(e for e in self.added if sure and not e.partial and not e.tentative)


def conduct(members: Sequence[Member], world: World, say: Callable[[str], None]) -> list[Said]:
    """Ask channel after channel, and again while another has named what one heeds; what each said last, in their order.

    Args:
        members: the channels that the recordings have.
        world: the user's model.
        say: is told what is being done.
    """
    said: dict[str, Said] = {}
    for _ in range(RULES.channel_rounds):
        news = False
        for member in members:
            others = [s for name, s in said.items() if name != member.name]
            assumed = tuple(e for s in others for e in s.firm if member.heeds(effect(e.effect)))
            if member.name in said and _alike(said[member.name].assumed, assumed):
                continue
            beside = f", with {', '.join(e.label for e in assumed)} as others found them" if assumed else ""
            say(f"{member.name}{beside}")
            said[member.name], news = Said(member, member.diagnose(world.add(*assumed)), assumed), True
        if not news:
            break
    return [said[member.name] for member in members]


def _alike(a: Sequence[EffectInstance], b: Sequence[EffectInstance]) -> bool:
    """Whether two lists of effects are the same but for what other values of theirs were fitted beside."""
    return {e.label for e in a} == {e.label for e in b}


def joined(said: Sequence[Said], world: World) -> Diagnosis:
    """One record and one model of what the channels said; arrays of a channel lie under `channel/NAME/`.

    The verdict is the gravest of theirs. The ladder is that of the channel whose error fell the most.
    """
    added: dict[str, EffectInstance] = {}
    listed: list[Any] = []
    for s in said:
        for e, row in zip(s.added, s.diagnosis.record["effects"], strict=True):
            if e.label not in added:
                added[e.label] = e
                listed.append({**row, "channel": s.member.name})
    records = [s.diagnosis.record for s in said]
    lead = max(records, key=_fall)
    rest = [r for r in records if r["unexplained"]]
    record = {
        "format": "vispeg-diagnosis/1",
        "verdict": min((r["verdict"] for r in records), key=ORDER.index),
        "reason": "; ".join(f"{s.member.name}: {s.diagnosis.record['reason']}" for s in said),
        "effects": listed,
        "ladder": lead["ladder"],
        "noise_floor": lead["noise_floor"],
        **({"of": lead["of"]} if "of" in lead else {}),
        "unexplained": rest[0]["unexplained"] if rest else None,
        "next_experiment": next((r["next_experiment"] for r in records if r["next_experiment"]), None),
        "candidates": [c for r in records for c in r["candidates"]],
        "recordings": lead["recordings"],
        "channels": [c for r in records for c in r.get("channels", [])],
        "remainder": [entry for r in records for entry in r.get("remainder", [])],
        "notes": [f"{s.member.name}: {note}" for s in said for note in s.diagnosis.record["notes"]],
        "by_channel": [_row(s) for s in said],
    }
    arrays = {f"channel/{s.member.name}/{key}": v for s in said for key, v in s.diagnosis.arrays.items()}
    return Diagnosis(cast("DiagnosisRecord", record), world.add(*added.values()), arrays)


def _row(s: Said) -> ChannelRecord:
    assumed = [{"effect": e.effect, "where": e.where} for e in s.assumed]
    return cast("ChannelRecord", {"channel": s.member.name, "given": assumed, "record": s.diagnosis.record})


def _fall(record: Mapping[str, Any]) -> float:
    first, last = (record["ladder"][at]["heldout_error"] for at in (0, -1))
    return (first / last if first and last else 1.0) if record["effects"] else 0.0
