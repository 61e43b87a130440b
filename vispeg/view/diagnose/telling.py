"""Turn the state of a search into the words and numbers that the page shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.diagnosis.evidence.localise import maps as drawn_maps
from vispeg.diagnosis.evidence.localise import missing_torque, worst
from vispeg.diagnosis.findings import Score
from vispeg.identify.evidence import Evidence
from vispeg.report.text import effect_words
from vispeg.view.diagnose.standing import Field, Named, Track
from vispeg.worlds.model_file import placed_dict
from vispeg.worlds.world import World

MOST = 3000  # most samples of a track that the page draws


def key(score: Score) -> str:
    """Return a candidate's members as `EFFECT:WHERE`, joined by ` + `."""
    return " + ".join(f"{e.effect}:{e.where}" for e in score.members)


def spelt(score: Score) -> str:
    """Return a candidate's members with the values that the fit started from, in the form that `parse` reads."""
    starts = [",".join(f"{name}={v.value!r}" for name, v in e.params.items()) for e in score.members]
    return " + ".join(f"{e.effect}:{e.where}:{s}" for e, s in zip(score.members, starts, strict=True))


def size(score: Score) -> int:
    """Return a candidate's number of parameters."""
    return sum(len(e.params) for e in score.members)


def words(score: Score) -> str:
    """Return a candidate's name in words, and the effects that it would replace."""
    name, where = score.key
    text = effect_words.named({"effect": name, "where": where})
    if score.beside:
        titles = " and ".join(dict.fromkeys(effect_words.title(e.effect) for e in score.members))
        text = f"{titles} in {len({e.where for e in score.members})} joints"
    return f"{text} in place of {_listed(score.out)}" if score.out else text


def changed(before: World, after: World) -> str:
    """Return in words what changed in a model: `+ A`, `− B`, `exchanged B for A`, its values or their intervals."""
    has, had = ({e.label for e in world.effects} for world in (after, before))
    gone = [e for e in before.effects if e.label not in has]
    new = [e for e in after.effects if e.label not in had]
    if gone and new:
        return f"exchanged {_listed(gone)} for {_listed(new)}"
    signed = [f"+ {_listed([e])}" for e in new] + [f"− {_listed([e])}" for e in gone]
    return "; ".join(signed) or ("intervals" if before.values == after.values else "refitted")


def _listed(effects: Sequence[EffectInstance]) -> str:
    return ", ".join(effect_words.named(placed_dict(e)) for e in effects)


def named(placed: EffectInstance) -> Named:
    """Return an effect with its name and size in words."""
    row = placed_dict(placed)
    return Named(effect_words.named(row), effect_words.size(row), f"{placed.effect}:{placed.where}")


def track(item: Any, first: np.ndarray, now: np.ndarray) -> Track:
    """Return the track of one item, with at most `MOST` samples."""
    every = slice(None, None, max(1, -(-len(item.segment.time) // MOST)))
    nj, valid = item.nj, item.valid[every, : item.nj]

    def column(values: np.ndarray) -> np.ndarray:
        return np.where(valid, values[every, :nj], np.nan).astype(np.float32)

    values = [column(item.measured), column(first), column(now)]
    rec, rows = item.recording, item.segment.rows
    wrench = None if rec.ft is None or rec.wrench is None or len(rows) != len(item.valid) else rec.ft[rows][every]
    cameras = tuple(rec.frames.names) if rec.frames is not None else ()
    time, arm = item.segment.time[every], np.nan_to_num(item.posture[every]).astype(np.float32)
    return Track(item.name, time, arm, values[0], values[1], values[2], wrench, cameras)


def maps(judged: Evidence, first: list[np.ndarray], now: list[np.ndarray]) -> dict[str, Field]:
    """Return maps of the missing torque of the given model and of the present one, axis -> map."""

    def missing(predicted: list[np.ndarray]) -> list:
        return [missing_torque(i, y[0]) for i, y in zip(judged.items, predicted, strict=True)]

    before, after = missing(first), missing(now)
    when = np.concatenate([np.column_stack([np.full(len(k.time), i), k.time]) for i, k in enumerate(before)])
    drawn, out = drawn_maps(before), {}
    remaining, at = drawn_maps(after, over=before), worst(after, over=before)
    for axis, (edges, grid) in drawn.items():
        moment = np.where(at[axis][..., None] < 0, np.nan, when[at[axis]])
        out[axis] = Field(edges, grid, remaining[axis][1], moment)
    return out
