"""Parts of a record specific to contact: channels by axis, failures by phase, arrays, effects not excited.

Throughout, `judged` are the compared recordings, and `predicted` are their wrenches: for each item (nworld, m, 6) N and
N m, of the given model and, if there is one, of the found model.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
from scipy.ndimage import binary_dilation

from vispeg.contact.evidence import ContactEvidence
from vispeg.contact.path import tips
from vispeg.contact.phases import NAMES
from vispeg.core.effect import effect
from vispeg.core.rules import RULES
from vispeg.diagnosis.conclusion.least_sizes import between
from vispeg.diagnosis.findings import Verdict
from vispeg.diagnosis.schema import Allowed, Failure, NotExcited, ShowsFrom
from vispeg.diagnosis.traces import arrays as arrays_of
from vispeg.diagnosis.traces import traces
from vispeg.identify.channels import UNITS
from vispeg.recordings.differentiate import bridged
from vispeg.worlds.world import World

COLUMNS = ("force x", "force y", "force z", "torque x", "torque y", "torque z")
LEAST_SHARE = 0.02  # smallest share of the residual that is listed
MOST = 0.5  # share of the remaining error from which a nuisance is mentioned
ALLOWANCES: dict[str, str] = {
    "sensor": "usual errors of a force sensor (drift, crosstalk, delay)",
    "path": (
        f"usual errors of kinematics ({1e3 * RULES.kinematics_place:.1g} mm, {1e3 * RULES.kinematics_turn:.1g} mrad)"
    ),
    "form": "errors that every contact law has (where a part sticks, chatters or bears)",
}


def channels(judged: ContactEvidence, predicted: Sequence[np.ndarray]) -> list[Any]:
    """Return the floor and the RMS errors of the given (before) and the found model (after) by axis."""
    out = []
    for j, name in enumerate(COLUMNS):
        kind = "force" if j < 3 else "moment"
        row = {"channel": kind, "joint": name, "floor": float(judged.floors[j]), "unit": f"{UNITS[kind]} RMS"}
        for w, key in zip(range(predicted[0].shape[0]), ("before", "after"), strict=False):
            row[key] = _rms(judged, predicted, w, j)
        out.append(row)
    return out


def _rms(judged: ContactEvidence, predicted: Sequence[np.ndarray], world: int, column: int) -> float:
    total, count = 0.0, 0
    for item, y in zip(judged.items, predicted, strict=True):
        good = item.valid[:, column]
        total += float(np.sum((item.measured - y[world])[good, column] ** 2))
        count += int(good.sum())
    return float(np.sqrt(total / max(count, 1)))


def where_it_fails(judged: ContactEvidence, predicted: Sequence[np.ndarray]) -> list[Failure]:
    """Return the greatest shares of the given model's squared residual in floors by axis and phase, at most eight.

    The residual is whitened in each block alone: whitening over blocks would spread an error of contact over free air.
    """
    grid = np.zeros((len(COLUMNS), len(NAMES)))
    for item, y in zip(judged.items, predicted, strict=True):
        r = judged.whiten(item, y[0])
        for k in range(len(NAMES)):
            grid[:, k] += (r[item.phase.code == k] ** 2).sum(axis=0)
    share = grid / max(float(grid.sum()), 1e-300)
    order = np.argsort(-share, axis=None)
    places = [np.unravel_index(i, share.shape) for i in order]
    rows: list[Failure] = [{"joint": COLUMNS[j], "regime": NAMES[k], "share": float(share[j, k])} for j, k in places]
    return [r for r in rows if r["share"] >= LEAST_SHARE][:8]


def phase_errors(judged: ContactEvidence, predicted: Sequence[np.ndarray]) -> list[dict[str, object]]:
    """Return for each phase that occurs: seconds, floor, N, and RMS force error before and after, N."""
    out = []
    for name in NAMES:
        row: dict[str, object] = {"phase": name}
        masks = [item.phase.of(name) & item.valid[:, :3].all(axis=1) for item in judged.items]
        count = sum(int(m.sum()) for m in masks)
        if not count:
            continue
        row["seconds"] = round(sum(i.period * int(m.sum()) for i, m in zip(judged.items, masks, strict=True)), 2)
        row["floor"] = _root([i.sigma[m, :3] for i, m in zip(judged.items, masks, strict=True)])
        for w, key in zip(range(predicted[0].shape[0]), ("before", "after"), strict=False):
            parts = zip(judged.items, predicted, masks, strict=True)
            row[key] = _root([(i.measured - y[w])[m, :3] for i, y, m in parts])
        out.append(row)
    return out


def worst_left(judged: ContactEvidence, predicted: Sequence[np.ndarray]) -> dict[str, object]:
    """Return the block with the largest force residual of the last world: recording, s, N, phase, tip from goal, m."""
    r, k = _worst(judged, [y[-1] for y in predicted], 3)
    item = judged.items[r]
    off = (item.measured - predicted[r][-1])[k, :3]
    tip = tips(item.path, item.source.scene)[item.phase.rows(item.path.time)[k]]
    return {
        "recording": item.name,
        "time_s": round(float(item.segment.time[k]), 2),
        "force": float(np.linalg.norm(off)),
        "phase": NAMES[item.phase.code[k]],
        "tip_m": [round(float(v), 5) for v in tip],
    }


def _root(parts: Sequence[np.ndarray]) -> float:
    values = np.concatenate([p.ravel() for p in parts])
    return float(np.sqrt(np.mean(values**2)))


def arrays(judged: ContactEvidence, predicted: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """Return measured and predicted wrenches, their phases, and the moment with the given model's largest residual."""
    drawn = traces(judged.items, predicted, [item.phase.code for item in judged.items])
    out, (r, k) = arrays_of(drawn, COLUMNS[:3], NAMES), _worst(judged, [y[0] for y in predicted], len(COLUMNS))
    item = judged.items[r]
    out["worst/moment"] = np.array(f"{item.name} at {item.segment.time[k]:.1f} s, {NAMES[item.phase.code[k]]}")
    rec, row = item.recording, item.segment.rows[k]
    out["worst/recording"], out["worst/q"] = np.array(item.name), bridged(rec.time, rec.q, rec.episode)[row]
    return out


def _worst(judged: ContactEvidence, predicted: Sequence[np.ndarray], columns: int) -> tuple[int, int]:
    """Return item and block of a world's largest residual in the first columns, among blocks in contact.

    `predicted` (m, 6) is one world's wrench for each item.
    """
    found = []
    for r, (item, y) in enumerate(zip(judged.items, predicted, strict=True)):
        size = (judged.whiten(item, y)[:, :columns] ** 2).sum(axis=1)
        k = int(np.argmax(np.where(item.phase.resting | _leaving(item.phase.code), -1.0, size)))
        found.append((float(size[k]), r, k))
    return max(found)[1:]


def _leaving(code: np.ndarray) -> np.ndarray:
    """Return blocks of free air next to contact, (m,) bool.

    They may contain some contact, which would be large against the low noise floor of free air.
    """
    free = code == NAMES.index("free")
    return free & binary_dilation(~free)


def allowed(judged: ContactEvidence, models: Mapping[str, World]) -> list[Allowed]:
    """Return for each model the shares of its squared residual explained by errors of sensor, path and model form."""
    return [cast("Allowed", {"model": name, **judged.taken(world)}) for name, world in models.items()]


def with_nuisance(verdict: Verdict, rows: Sequence[Allowed]) -> Verdict:
    """Mention in a verdict the nuisance that explains most of the final residual, if it explains at least `MOST`.

    An effect that looks like such a nuisance would not be detected.
    """
    last = rows[-1]
    share, kind = max(((last["sensor"], "sensor"), (last["path"], "path"), (last["form"], "form")))
    words = ALLOWANCES[kind]
    if share < MOST:
        return verdict
    text = f"{words} can explain {100 * share:.0f} % of the remaining error, so effects no larger cannot be detected"
    return replace(verdict, reason=f"{verdict.reason}; {text}")


def not_excited(
    least_sizes: Mapping[tuple[str, str], Mapping[str, float]], recorded: Collection[str] = ()
) -> list[NotExcited]:
    """Return effects without a detectable size, each with the first motion not `recorded` yet that would show it."""
    out: list[NotExcited] = []
    for (name, where), least in least_sizes.items():
        if not any(np.isfinite(list(least.values()))):
            motions = effect(name).shown_by or ("insert",)
            motion = next((m for m in motions if m not in recorded), motions[0])
            why = "no size of it changes the wrench detectably in these recordings"
            out.append({"effect": name, "where": where, "why": why, "motion": motion})
    return out


def shows_from(least_sizes: Mapping[tuple[str, str], Mapping[str, float]]) -> list[ShowsFrom]:
    """Return for every effect the range of each parameter in which the recordings would not show it."""
    return [
        {"effect": name, "where": where, "between": between(name, least)}
        for (name, where), least in least_sizes.items()
    ]
