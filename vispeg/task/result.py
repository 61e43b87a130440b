"""How an episode ended, as the task says it: the `record` in the infos of an episode's last step."""

from __future__ import annotations

from typing import NotRequired, TypedDict


class EpisodeResult(TypedDict):
    """One episode that ended. A mapping, as gymnasium's infos are.

    Keys:
        success, category: the outcome; one of the task's categories.
        seed: of the episode.
        time: s, its duration.
        peak_force: N, largest contact force.
        lateral_error: m, distance of the tip from the goal's axis at the end.
        depth: m, depth of the tip below the goal's plane at the end.
        clipped: share of its steps in which the action asked for more than the controller takes.
        force_profile: N, contact force at every control tick.
        world: what the world drew: `effect(place)` -> parameter -> value.
        replay: the folder in which a diverged episode was left, where that was asked for.
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
