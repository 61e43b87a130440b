"""Stress test with pushes and hard positions: conditions in which a policy that does well on average may fail.

Kaspar and Bock (docs/sources.md) pushed the arm away from the goal by hand and state no force. Here every pushed
episode gets 20 to 60 N from any side for 0.2 s. Every position of a frozen list is played with and without a push, on
the same seeds. Each position has its own interval, because an average over positions hides one that always fails.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.evaluation.jobs import Pushes, Setting
from vispeg.evaluation.lists import read_list
from vispeg.evaluation.overlay import Change
from vispeg.evaluation.records import Episode
from vispeg.evaluation.schema.stress import HardPosition, PushRecord, PushRow
from vispeg.evaluation.statistics import RULE, decide, difference, rate
from vispeg.evaluation.table import rows
from vispeg.formats.format import Format, copy, enrol
from vispeg.task.contract import Task
from vispeg.task.registry import FIRST, config_of, scene_of, task
from vispeg.task.world_file import WorldFile, load_world

FORMAT = "vispeg-perturb/1"
LIST = Format("vispeg-positions/1", "a list of positions", keys=("name", "about", "positions"))
KEYS = ("name", "x", "y", "height", "roll", "pitch", "yaw")
FREE, PUSHED = "anywhere", ", pushed"


def _listed(task: Task) -> Path:
    if task.hard_positions is None:
        raise UserError("the task has no list of hard positions", key="--positions", expected="a file", got=task.label)
    return task.hard_positions


@enrol(LIST.name, lambda folder: copy(_listed(task(FIRST)), folder))
def positions(path: Path | None = None, of: Task | None = None) -> list[HardPosition]:
    """Return the hard positions in a file, or those of a task.

    Args:
        path: the user's own list; None for the task's.
        of: the task; None for the first built-in one.

    Raises:
        UserError: as `read_list`, a value that is not a number, or a task without a list.
    """
    file = path or _listed(of or task(FIRST))
    listed = read_list(file, LIST, "positions", KEYS)
    for i, entry in enumerate(listed):
        for key in KEYS[1:]:
            if key in entry and (isinstance(entry[key], bool) or not isinstance(entry[key], int | float)):
                at = f"positions[{i}].{key}"
                raise UserError("not a number", file=file, key=at, expected="m or rad", got=entry[key])
    return [cast("HardPosition", entry) for entry in listed]


def settings(world: str, name: str, listed: Sequence[HardPosition], pushes: Pushes | None = None) -> list[Setting]:
    """Return the settings, all without a push and then all with one.

    The first of each has the goal where the world draws it. The others have it at the listed positions, and the tip
    starts right above its nominal place.
    """
    entries, scene = [], scene_of(load_world(world).task)
    for push, suffix in ((None, ""), (pushes or Pushes(), PUSHED)):
        entries.append(Setting(world, name, FREE + suffix, pushes=push))
        for p in listed:
            tilt = {k: float(v) for k, v in p.items() if k in ("roll", "pitch", "yaw") and isinstance(v, int | float)}
            changes = [Change(scene.offset, {"x": float(p.get("x", 0.0)), "y": float(p.get("y", 0.0)), "z": 0.0})]
            changes += [Change(scene.tilt, tilt)] if tilt else []
            entries.append(Setting(world, name, p["name"] + suffix, tuple(changes), _starts(p), push))
    return entries


def check(listed: Sequence[HardPosition], file: Path | None, world: WorldFile) -> None:
    """Raise UserError, naming the file, for a position that the world's task cannot start from."""
    scene = scene_of(world.task)
    bounds = {key: effect(scene.offset).params[key] for key in ("x", "y")}
    bounds |= {key: effect(scene.tilt).params[key] for key in ("roll", "pitch", "yaw")}
    for i, p in enumerate(listed):
        for key, param in bounds.items():
            value = float(p.get(key, param.null))
            if not param.low <= value <= param.high:
                expected = f"{param.low:g} to {param.high:g} {param.unit}"
                raise UserError("out of bounds", file=file, key=f"positions[{i}].{key}", expected=expected, got=value)
        try:
            config_of({**world.task, **_starts(p)})
        except UserError as error:
            raise UserError(str(error), file=file, key=f"positions[{i}].height") from error


def _starts(p: HardPosition) -> dict[str, Any]:
    """Return the task settings that make the tip start right above the nominal goal, at the position's height."""
    return {"start_radius": 0.0} | ({"start_height": [float(p["height"])] * 2} if "height" in p else {})


def summarise(episodes: Sequence[Episode]) -> PushRecord:
    """Return the content of perturb.json: success at each position without and with a push.

    The cost is success without the push minus success with it, on the same seeds. The tests of all policies and
    positions are one family.
    """
    names = dict.fromkeys(e.configuration.removesuffix(PUSHED) for e in episodes)
    sides = {
        (policy, name): [
            rows(e for e in episodes if e.policy == policy and e.configuration == name + suffix)
            for suffix in ("", PUSHED)
        ]
        for policy in dict.fromkeys(e.policy for e in episodes)
        for name in names
    }
    costs = {
        key: difference(still, pushed, same_networks=True) for key, (still, pushed) in sides.items() if still and pushed
    }
    decided = decide(costs)
    made: list[PushRow] = []
    for (policy, position), (still, pushed) in sides.items():
        cost = decided.get((policy, position))
        made.append(
            {
                "policy": policy,
                "position": position,
                "still": rate(still).to_json() if still else None,
                "pushed": rate(pushed).to_json() if pushed else None,
                "cost": cost.estimate.to_json() if cost else None,
                "p_holm": cost.p_holm if cost else None,
                "verdict": cost.verdict if cost else None,
            }
        )
    return {"format": FORMAT, "rows": made, "rule": RULE}
