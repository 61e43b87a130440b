"""Decide which channels a model and its recordings are compared in, for every command, the page and the API.

A channel counts only if every recording has it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from vispeg.channels.channel import CHANNELS, Channel
from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.recordings.recording import Recording
from vispeg.worlds.world import World

OTHERS = "the variable VISPEG_PLUGINS names modules that add channels"  # hint after the list of channels


def channel(name: str, key: str = "--channels") -> Channel:
    """Return a channel by its name.

    Raises:
        UserError: there is none of that name; the message names the user's option, `key`.
    """
    if name not in CHANNELS:
        raise UserError("unknown channel", key=key, got=name, choices=[c.name for c in ordered()], see=OTHERS)
    return CHANNELS[name]


def ordered() -> list[Channel]:
    """Return all channels in the order in which they are diagnosed."""
    return sorted(CHANNELS.values(), key=lambda c: (c.order, c.name))


def resolve(
    world: World, *groups: Sequence[Recording], asked: str | Sequence[str] = (), key: str = "--channels"
) -> tuple[str, ...]:
    """Return the names of the channels to compare in, in the order in which they are diagnosed.

    By default these are all that the recordings have, with one exception: in a task's cell without pictures or without
    a wrench, joints are compared only if there is no other channel, since an arm in contact is stiff and slow and its
    joints show next to nothing. If there is no channel at all, the result is the joints: reading them then fails with
    a message on the missing column.

    Args:
        world: the model.
        groups: recordings, fitted and held out.
        asked: the channels that the user wants; empty for the default.
        key: the option by which the user asked, for messages.

    Raises:
        UserError: a channel asked for that is unknown or that the model or a recording lacks, or a recording of contact
            without wrench and torques.
    """
    asked, present = [asked] if isinstance(asked, str) else asked, available(world, *groups)
    for name in asked:
        if channel(name, key).name not in present:
            what = "the model or one of the recordings does not have this channel"
            raise UserError(what, key=key, got=name, choices=present)
    with_joints = world.cell is None or {"pictures", "contact"} <= set(present)
    default = present if with_joints else tuple(name for name in present if name != "joints") or present
    return tuple(name for name in present if name in (asked or default)) or ("joints",)


def available(world: World, *groups: Sequence[Recording]) -> tuple[str, ...]:
    """Return the names of the channels that a model and all recordings have.

    Raises:
        UserError: a recording of contact without wrench and torques.
    """
    recordings = [rec for group in groups for rec in group]
    return tuple(c.name for c in ordered() if c.has(world, recordings))


def fitted_in(channels: Sequence[str], effects: Iterable[str]) -> str:
    """Return the channel in which to fit these effects: the one that shows most of them, the first of equal ones."""
    kinds = [effect(name) for name in effects]
    return max(channels, key=lambda name: sum(CHANNELS[name].shows(kind) for kind in kinds))
