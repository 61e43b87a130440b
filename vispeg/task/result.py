"""The result of an episode: `record` in the infos of its last step."""

from __future__ import annotations

from typing import NotRequired, TypedDict


class EpisodeResult(TypedDict):
    """The result of one episode. It is a mapping, like gymnasium's infos.

    Keys:
        success: whether the task was achieved.
        category: how the episode ended, one of the task's categories.
        seed: of the episode.
        time: s, its duration.
        peak_force: N, largest contact force.
        lateral_error: m, distance of the tip from the goal's axis, at the end.
        depth: m, depth of the tip below the goal's plane at the end.
        clipped: share of its policy steps in which some entry of the action was outside +-1.
        force_profile: N, contact force at every control tick.
        world: the values that were drawn for the episode: `effect(place)` -> parameter -> value.
        replay: folder in which a diverged episode was saved; only if the environment has a `dump` folder.
    """

    success: bool
    category: str
    seed: int
    time: float
    peak_force: float
    lateral_error: float
    depth: float
    clipped: float
    force_profile: tuple[float, ...]
    world: dict[str, dict[str, float]]
    replay: NotRequired[str]
