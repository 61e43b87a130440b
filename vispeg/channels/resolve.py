"""Which channels a model and its recordings have: the one place that says so, for every command, the page and the API.

All recordings must have a channel.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from vispeg.channels.channel import CHANNELS, Channel
from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.recordings.recording import Recording
from vispeg.worlds.world import World

OTHERS = "the variable VISPEG_PLUGINS names modules with others"


def channel(name: str, key: str = "--channels") -> Channel:
    """Give a channel by its name.

    Raises:
        UserError: there is none of that name; `key` is how the user asked.
    """
    if name not in CHANNELS:
        raise UserError("unknown channel", key=key, got=name, choices=[c.name for c in ordered()], see=OTHERS)
    return CHANNELS[name]


def ordered() -> list[Channel]:
    """Give all channels in the order in which they are diagnosed."""
    return sorted(CHANNELS.values(), key=lambda c: (c.order, c.name))


def resolve(
    world: World, *groups: Sequence[Recording], asked: str | Sequence[str] = (), key: str = "--channels"
) -> tuple[str, ...]:
    """Name the channels that a model and recordings are compared in, in the order in which they are diagnosed.

    By default all that they have; but in a task's cell that was not photographed, or where no wrench was felt, the
    joints only where nothing else is there: the arm is stiff and slow in contact, and shows next to nothing there.
    Where they have none it is the joints, whose reader says which column is missing.

    Args:
        world: the model.
        groups: recordings, fitted and held out.
        asked: a channel or several that are wanted; empty for the default.
        key: how the user asked, for errors.

    Raises:
        UserError: a channel asked for that is unknown or that a recording lacks, or a recording of contact without
            wrench and torques.
    """
    asked, can = [asked] if isinstance(asked, str) else asked, available(world, *groups)
    for name in asked:
        if channel(name, key).name not in can:
            raise UserError("not all of the recordings have this channel", key=key, got=name, choices=can)
    whole = world.cell is None or {"pictures", "contact"} <= set(can)
    usual = can if whole else tuple(name for name in can if name != "joints") or can
    return tuple(name for name in can if name in (asked or usual)) or ("joints",)


def available(world: World, *groups: Sequence[Recording]) -> tuple[str, ...]:
    """Name the channels that a model and all recordings have.

    Raises:
        UserError: a recording of contact without wrench and torques.
    """
    recordings = [rec for group in groups for rec in group]
    return tuple(c.name for c in ordered() if c.has(world, recordings))


def fitted_in(channels: Sequence[str], effects: Iterable[str]) -> str:
    """Name the channel of several that a fit of these effects is made to: the first that shows most of them."""
    kinds = [effect(name) for name in effects]
    return max(channels, key=lambda name: sum(CHANNELS[name].shows(kind) for kind in kinds))
