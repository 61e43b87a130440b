"""Regression suite: named configurations in the training world and in the target, tracked over a policy's versions.

After the practitioners' article, the correlation of success between training world and target, over configurations, is
healthy above 0.8 and an alarm below 0.6. A low correlation means that the training world no longer ranks situations as
the target does, whatever the averages are. The status follows from the interval of the correlation of the true rates,
which is corrected for the noise of the episodes (`vispeg.evaluation.statistics.correlation`):

* alarm: the whole interval lies below 0.6;
* healthy: the whole interval lies above 0.6, and the correlation above 0.8;
* cannot tell: the interval contains both 0.6 and 0.8;
* watch: otherwise.

A correlation does not show a loss that is the same in all configurations. So a mean loss whose whole interval lies
above 5 points is an alarm, whatever the correlation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

import numpy as np

from vispeg.core.errors import UserError
from vispeg.evaluation.jobs import Setting
from vispeg.evaluation.lists import HERE, read_list
from vispeg.evaluation.overlay import Change
from vispeg.evaluation.records import Episode, check_worlds
from vispeg.evaluation.schema.estimate import Interval
from vispeg.evaluation.schema.suite import (
    Configuration,
    Fall,
    Health,
    Measures,
    SuiteRecord,
    SuiteRow,
    VersionChange,
)
from vispeg.evaluation.statistics import (
    CANNOT_TELL,
    FEWEST_POLICIES,
    MARGIN,
    Difference,
    correlation,
    decide,
    difference,
    fall,
    mean_interval,
    noise,
    rate,
)
from vispeg.evaluation.table import rows
from vispeg.formats.format import Format, copy, enrol
from vispeg.task.registry import config_of, task_of
from vispeg.worlds.entry import ranged

FORMAT = "vispeg-suite-result/1"
LIST = Format("vispeg-suite/1", "a suite", keys=("name", "about", "configurations"))
HEALTHY, ALARM = 0.8, 0.6
KEYS = ("name", "task", "effects", "about")


@enrol(LIST.name, lambda folder: copy(HERE / "suite.yaml", folder))
def configurations(path: Path | None = None) -> list[Configuration]:
    """Return the configurations of the user's own suite, or those of the package's for None.

    Raises:
        UserError: as `read_list`, or an invalid task setting or effect.
    """
    file = path or HERE / "suite.yaml"
    listed = read_list(file, LIST, "configurations", KEYS)
    standard = config_of({})
    cell = task_of(standard).cell(standard)
    for i, entry in enumerate(listed):
        at = f"configurations[{i}]"
        task, effects = entry.get("task") or {}, entry.get("effects") or []
        if not isinstance(task, dict):
            raise UserError("wrong task", file=file, key=f"{at}.task", expected="a mapping", got=task)
        if not isinstance(effects, list):
            raise UserError("wrong effects", file=file, key=f"{at}.effects", expected="a list", got=effects)
        config_of(task, f"{file}: {at}")
        for j, effect in enumerate(effects):
            place = {"where": "all"} if isinstance(effect, dict) and effect.get("where") in (None, "*") else {}
            ranged(effect | place if place else effect, cell, file, f"{at}.effects[{j}]")
    return [cast("Configuration", entry) for entry in listed]


def settings(listed: Sequence[Configuration], worlds: Mapping[str, str]) -> list[Setting]:
    """Return the setting of every configuration in every world (name -> path or built-in name)."""
    entries = []
    for name, world in worlds.items():
        for c in listed:
            changes = [Change(e["effect"], e.get("params") or {}, e.get("where", "*")) for e in c.get("effects") or ()]
            entries.append(Setting(world, name, c["name"], tuple(changes), dict(c.get("task") or {})))
    return entries


def summarise(
    episodes: Sequence[Episode], train: str, target: str, version: str, hashes: Mapping[str, str] | None = None
) -> SuiteRecord:
    """Return the content of suite.json.

    Args:
        episodes: episodes of all policies in both worlds.
        train, target: names of the training world and of the target.
        version: name of the policy's version.
        hashes: world -> hash without a configuration; "" for a measured target. The record also has those of the
            configurations, under `WORLD / CONFIGURATION`.

    Raises:
        UserError: no configuration with episodes in both worlds, or a world's name with two hashes.
    """
    all_hashes = {**(hashes or {}), **{name: h for name, h in check_worlds(episodes).items() if h}}
    found: list[SuiteRow] = []
    noises: list[np.ndarray] = []  # covariance (2, 2) of each row's two rates
    falls: dict[str, Difference] = {}
    for policy in dict.fromkeys(e.policy for e in episodes):
        both = []
        for c in dict.fromkeys(e.configuration for e in episodes if e.policy == policy):
            first, second = (
                rows(e for e in episodes if (e.policy, e.configuration, e.world) == (policy, c, w))
                for w in (train, target)
            )
            tried = [t for t in first if t in second]  # a robot may have tried only one of several networks
            if tried:
                first, second = ({t: side[t] for t in tried} for side in (first, second))
                sides = [rate(side).to_json() for side in (first, second)]
                found.append({"configuration": c, "policy": policy, "train": sides[0], "target": sides[1]})
                noises.append(noise(first, second))
                both.append((first, second))
        if both:
            falls[policy] = fall(both)
    if not found:
        raise UserError("no configuration with episodes in both worlds", got=f"{train}, {target}")
    decided = decide(falls)
    lost: list[Fall] = [
        {"policy": policy, "fall": d.estimate.to_json(), "beyond_doubt": not d.refused and d.estimate.low > MARGIN}
        for policy, d in decided.items()
    ]
    return {
        "format": FORMAT,
        "version": version,
        "train": train,
        "target": target,
        "worlds": [{"name": name, "hash": h} for name, h in all_hashes.items()],
        "rows": found,
        "falls": lost,
        "health": _health(found, noises, lost),
    }


def _health(found: Sequence[SuiteRow], noises: Sequence[np.ndarray], falls: Sequence[Fall]) -> Health:
    """Return the verdict on a version, from the correlation and the policies' losses."""
    measures, status, words = _correlation(found, noises)
    fallen = [f for f in falls if f["beyond_doubt"]]
    if fallen:
        lost = [f"{f['policy']} loses {_points(f['fall'])} from the training world to the target" for f in fallen]
        status, words = "alarm", "; ".join([*lost, words])
    return {**measures, "n": len(found), "status": status, "words": f"{status}: {words}"}


def _points(e: Interval) -> str:
    value, low, high = (100 * (math.nan if v is None else v) for v in (e["value"], e["low"], e["high"]))
    return f"{value:.0f} points ({low:.0f} to {high:.0f})"


def _correlation(found: Sequence[SuiteRow], noises: Sequence[np.ndarray]) -> tuple[Measures, str, str]:
    """Return the correlation over configurations as measures, status and words."""
    if len(found) < FEWEST_POLICIES:
        return {}, CANNOT_TELL, f"{len(found)} configurations, a correlation needs {FEWEST_POLICIES}"
    x, y = (np.array([r[side]["value"] for r in found], float) for side in ("train", "target"))
    r = correlation(x, y, noises)
    measures: Measures = {"pearson": r.to_json(), "mean_difference": mean_interval(x - y).to_json()}
    numbers = f"r = {r.value:.2f} ({r.low:.2f} to {r.high:.2f})".replace("-", "−")
    if r.high < ALARM:
        status = "alarm"
    elif r.low > ALARM:
        status = "healthy" if r.value > HEALTHY else "watch"
    else:
        status = "watch" if r.high < HEALTHY else CANNOT_TELL
    if status != CANNOT_TELL:
        return measures, status, f"{numbers} over {len(found)} configurations"
    if r.low == -1 and r.high == 1:
        return measures, status, "success hardly varies over the configurations, so these episodes cannot tell"
    return measures, status, f"{numbers} over {len(found)} configurations, so these episodes cannot tell"


def other_worlds(versions: Sequence[SuiteRecord]) -> list[str]:
    """Return a line for each earlier version whose configurations were other worlds, or are not known.

    Raises:
        UserError: the training world or the target was another one, so that the correlations cannot be compared.
    """
    last, lines = versions[-1], []
    now = _hashes(last)
    for v in versions[:-1]:
        then = _hashes(v)
        for side in ("train", "target"):
            old, new = then.get(v[side]), now.get(last[side])
            if old is not None and new is not None and old != new:
                names = [f"{name} {h[:12] or 'measured'}" for name, h in ((v[side], old), (last[side], new))]
                message = f"versions {v['version']} and {last['version']} were made in different worlds"
                raise UserError(message, key=side, expected=names[0], got=names[1])
        if changed := [name for name in then if now.get(name, then[name]) != then[name]]:
            lines.append(f"{v['version']}: made in other worlds than {last['version']}: {', '.join(changed)}")
        elif not then:
            lines.append(f"{v['version']}: does not tell the hashes of its worlds")
    return lines


def _hashes(version: SuiteRecord) -> dict[str, str]:
    return {w["name"]: w["hash"] for w in version.get("worlds") or ()}


def regressions(old: Sequence[Episode], new: Sequence[Episode]) -> list[VersionChange]:
    """Compare two versions in every configuration and world that both played on the same seeds.

    A robot's trials have no seeds: those of the two versions are independent samples.

    Policies are paired by name; if no name agrees, the only policy of each version is. The change is success of the new
    version minus that of the old; the verdict is `fell`, `rose`, `equal`, or that these data cannot tell.

    Raises:
        UserError: the versions have no policy or no configuration in common.
    """
    names = [list(dict.fromkeys(e.policy for e in side)) for side in (old, new)]
    shared = [n for n in names[0] if n in names[1]]
    pairs = [(n, n) for n in shared] or ([(names[0][0], names[1][0])] if len(names[0]) == len(names[1]) == 1 else [])
    if not pairs:
        raise UserError("versions with no policy in common", expected=", ".join(names[0]), got=", ".join(names[1]))
    compared: dict[tuple[str, str, str], Difference] = {}
    for a, b in pairs:
        for world, c in dict.fromkeys((e.world, e.configuration) for e in new if e.policy == b):
            before, after = (
                [e for e in side if (e.policy, e.world, e.configuration) == (n, world, c)]
                for side, n in ((old, a), (new, b))
            )
            if before and after and {e.world_hash for e in before} == {e.world_hash for e in after}:
                sides = [  # a robot's trials have no hash; with the version in their key, they do not pair
                    rows(side, lambda e, version=version: e.seed if e.world_hash else (version, e.seed))
                    for version, side in (("new", after), ("old", before))
                ]
                if not after[0].world_hash or set.intersection(*(set(row) for side in sides for row in side.values())):
                    compared[b, world, c] = difference(*sides, same_networks=False)
    if not compared:
        raise UserError("versions with no configuration in common, in the same world on the same seeds")
    changes: list[VersionChange] = []
    for (policy, world, configuration), d in decide(compared).items():
        fell = "fell" if d.estimate.value < 0 else "rose"
        changes.append(
            {
                "policy": policy,
                "world": world,
                "configuration": configuration,
                "change": d.estimate.to_json(),
                "p_holm": d.p_holm,
                "verdict": fell if d.certain else d.verdict,
            }
        )
    return changes
