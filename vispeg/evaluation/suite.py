"""The regression suite: named configurations in the training world and in the target, tracked over versions of a
policy.

After the practitioners' article: the correlation of success between simulation and target, over configurations, is
healthy above 0.8 and an alarm below 0.6. A low correlation means that the training world no longer ranks situations
as the target does, whatever the averages say. Where success hardly varies there is no correlation to speak of, and
these data cannot tell. A correlation does not see a fall that is the same everywhere: one beyond doubt
(`vispeg.evaluation.statistics.fall`) is an alarm whatever the correlation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
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
from vispeg.evaluation.statistics.crossed import difference, rate
from vispeg.evaluation.statistics.decide import CANNOT_TELL, decide
from vispeg.evaluation.statistics.fall import beyond_doubt, fall
from vispeg.evaluation.statistics.intervals import Estimate
from vispeg.evaluation.statistics.ranks import FEWEST, predict
from vispeg.evaluation.statistics.significance import holm, mcnemar
from vispeg.evaluation.table import Cell, Table
from vispeg.formats.format import Format, copy, enrol
from vispeg.task.registry import config_of, task_of
from vispeg.worlds.entry import ranged

FORMAT = "vispeg-suite-result/1"
LIST = Format("vispeg-suite/1", "a suite", keys=("name", "about", "configurations"))
HEALTHY, ALARM = 0.8, 0.6
SPREAD = 0.05  # standard deviation of success over configurations below which it does not vary
KEYS = ("name", "task", "effects", "about")


@enrol(LIST.name, lambda folder: copy(HERE / "suite.yaml", folder))
def configurations(path: Path | None = None) -> list[Configuration]:
    """The suite that comes with the package, or one of the user's own.

    Raises:
        UserError: as `read_list`; a task or an effect that no world can have.
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
    """Every configuration in every world (name -> path or built-in name)."""
    entries = []
    for name, world in worlds.items():
        for c in listed:
            changes = [Change(e["effect"], e.get("params") or {}, e.get("where", "*")) for e in c.get("effects") or ()]
            entries.append(Setting(world, name, c["name"], tuple(changes), dict(c.get("task") or {})))
    return entries


def summarise(
    episodes: Sequence[Episode], train: str, target: str, version: str, hashes: Mapping[str, str] | None = None
) -> SuiteRecord:
    """{format, version, train, target, worlds, rows: [{configuration, policy, train, target}], falls, health}.

    `falls` is [{policy, fall, beyond_doubt}], success in the training world less that in the target.
    `worlds` is [{name, hash}] of training world and target as they are (from `hashes`; "" for a measured target) and of
    every configuration, `WORLD / CONFIGURATION`.

    Raises:
        UserError: no configuration with episodes on both sides, one world's name under two hashes.
    """
    made = {**(hashes or {}), **{name: h for name, h in check_worlds(episodes).items() if h}}
    rows: list[SuiteRow] = []
    falls: list[Fall] = []
    for policy in dict.fromkeys(e.policy for e in episodes):
        both = []
        for c in dict.fromkeys(e.configuration for e in episodes if e.policy == policy):
            sides = [
                [e for e in episodes if (e.policy, e.configuration, e.world) == (policy, c, w)] for w in (train, target)
            ]
            if all(sides):
                estimates = [rate(Table(side).outcomes(Cell(policy, side[0].world))).to_json() for side in sides]
                rows.append({"configuration": c, "policy": policy, "train": estimates[0], "target": estimates[1]})
                both.append((sides[0], sides[1]))
        if both:
            lost = fall(both)
            falls.append({"policy": policy, "fall": lost.to_json(), "beyond_doubt": beyond_doubt(lost)})
    if not rows:
        raise UserError("no configuration with episodes in both worlds", got=f"{train}, {target}")
    return {
        "format": FORMAT,
        "version": version,
        "train": train,
        "target": target,
        "worlds": [{"name": name, "hash": h} for name, h in made.items()],
        "rows": rows,
        "falls": falls,
        "health": health(rows, falls),
    }


def health(rows: Sequence[SuiteRow], falls: Sequence[Fall] = ()) -> Health:
    """{pearson, mean_difference, mmrv, n, status, words}; status: healthy, watch, alarm or cannot tell."""
    measures, status, words = _correlation(rows)
    fallen = [f for f in falls if f["beyond_doubt"]]
    if fallen:
        lost = [f"{f['policy']} loses {_points(f['fall'])} from the training world to the target" for f in fallen]
        status, words = "alarm", "; ".join([*lost, words])
    return {**measures, "n": len(rows), "status": status, "words": f"{status}: {words}"}


def _points(e: Interval) -> str:
    value, low, high = (100 * (math.nan if v is None else v) for v in (e["value"], e["low"], e["high"]))
    return f"{value:.0f} points ({low:.0f} to {high:.0f})"


def _correlation(rows: Sequence[SuiteRow]) -> tuple[Measures, str, str]:
    """What a correlation over the configurations says: measures, status, words."""
    if len(rows) < FEWEST:
        return {}, CANNOT_TELL, f"{len(rows)} configurations, a correlation needs {FEWEST}"
    x = np.array([r["train"]["value"] for r in rows], float)
    y = np.array([r["target"]["value"] for r in rows], float)
    prediction = predict(x, y, stream(0, "suite health"))
    measures: Measures = {
        "pearson": prediction.pearson.to_json(),
        "mmrv": prediction.mmrv.to_json(),
        "mean_difference": prediction.mean_difference.to_json(),
    }
    r = prediction.pearson
    if min(x.std(), y.std()) < SPREAD or not math.isfinite(r.value):
        return measures, CANNOT_TELL, "success hardly varies over the configurations, so there is no correlation"
    status = "healthy" if r.value > HEALTHY else "alarm" if r.value < ALARM else "watch"
    numbers = f"r = {r.value:.2f} ({r.low:.2f} to {r.high:.2f})".replace("-", "−")
    return measures, status, f"{numbers} over {len(rows)} configurations"


def other_worlds(versions: Sequence[SuiteRecord]) -> list[str]:
    """A line a version whose configurations were other worlds than the last version's, or which does not tell.

    Raises:
        UserError: the training world or the target was another one, so that the correlations are not of the same thing.
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
    """Every configuration and world that both versions ran on the same seeds: what fell, what rose.

    Policies are paired by name where the names agree, else the only one of each side. [{world, configuration, change,
    p_holm, verdict}],
    change: new minus old; verdict `fell`, `rose`, `equal` or that these data cannot tell.

    Raises:
        UserError: nothing in common, or versions with several policies under different names.
    """
    names = [list(dict.fromkeys(e.policy for e in side)) for side in (old, new)]
    shared = [n for n in names[0] if n in names[1]]
    pairs = [(n, n) for n in shared] or ([(names[0][0], names[1][0])] if len(names[0]) == len(names[1]) == 1 else [])
    if not pairs:
        raise UserError("versions with no policy in common", expected=", ".join(names[0]), got=", ".join(names[1]))
    compared: list[tuple[str, str, str, Estimate]] = []
    p = []
    for a, b in pairs:
        cells = [(e.world, e.configuration) for e in new if e.policy == b]
        for world, c in dict.fromkeys(cells):
            before, after = (
                _only([e for e in side if (e.policy, e.world, e.configuration) == (n, world, c)])
                for side, n in ((old, a), (new, b))
            )
            if before is None or after is None or before.hashes != after.hashes:
                continue
            cell = [Cell(table.policies[0], world) for table in (before, after)]
            seeds = sorted(set(before.seeds(cell[:1])) & set(after.seeds(cell[1:])))
            if not seeds:
                continue
            y = [t.outcomes(k, seeds) for t, k in zip((after, before), cell[::-1], strict=True)]
            k = min(map(len, y))
            change = difference(y[0], y[1], same_networks=False)
            p.append(mcnemar(y[0][:k], y[1][:k]).p)
            compared.append((b, world, c, change))
    if not compared:
        raise UserError("versions with no configuration in common, in the same world on the same seeds")
    rows: list[VersionChange] = []
    for (policy, world, configuration, change), adjusted in zip(compared, holm(p), strict=True):
        verdict: str = decide(change, adjusted)
        if verdict == "different":
            verdict = "fell" if change.value < 0 else "rose"
        rows.append(
            {
                "policy": policy,
                "world": world,
                "configuration": configuration,
                "change": change.to_json(),
                "p_holm": adjusted,
                "verdict": verdict,
            }
        )
    return rows


def _only(episodes: Sequence[Episode]) -> Table | None:
    return Table([replace(e, configuration="") for e in episodes]) if episodes else None
