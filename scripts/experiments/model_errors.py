"""How far a model's episodes are from a plant's: peak force, time in contact and duration, paired by episode."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from vispeg.core.seeds import stream
from vispeg.evaluation.records import Episode
from vispeg.evaluation.statistics import LEVEL, wilson

TOUCH = 1.0  # N, from which a tool touches
RESAMPLED = 4000  # draws of the bootstrap
ROUNDED = 1e-9  # an error no greater is none


def in_contact(episode: Episode) -> float:
    """Return the seconds of an episode, in whole steps of the policy, in which more than `TOUCH` acted."""
    force = np.array(episode.force_profile or ())
    return float(np.mean(force > TOUCH)) * episode.time if force.size else float("nan")


MEASURES: dict[str, tuple[Callable[[Episode], float], str]] = {
    "peak force": (lambda e: e.peak_force, "N"),
    "time in contact": (in_contact, "s"),
    "duration": (lambda e: e.time, "s"),
}


def errors(plant: Sequence[Episode], models: Mapping[str, Sequence[Episode]], first: str) -> dict[str, Any]:
    """Return the errors of models against the plant, each episode against the one with its seed.

    Args:
        plant: episodes of one policy in the plant.
        models: by name, those of the same policy on the same seeds.
        first: the model that the others are compared with.

    Returns:
        {episodes, success: {name: Wilson}, measures: {measure: {unit, plant, error: {model: ..}, ratio: {model: ..}}}}:
        `plant` is the mean, `error` the mean of |model - plant|, `ratio` that over the error of `first`; each is
        {value, low, high} with the 95 % percentile interval of a bootstrap over episodes, the same draws for all.
    """
    seeds = [e.seed for e in plant]
    if any([e.seed for e in played] != seeds for played in models.values()):
        raise ValueError("episodes are paired by their seeds")
    draws = stream(0, "model errors").integers(len(seeds), size=(RESAMPLED, len(seeds)))
    out: dict[str, Any] = {"episodes": len(seeds), "success": {}, "measures": {}}
    for name, played in {"plant": plant, **models}.items():
        out["success"][name] = wilson(sum(e.success for e in played), len(played)).to_json()
    for measure, (value, unit) in MEASURES.items():
        truth = np.array([value(e) for e in plant])
        off = {name: np.abs(np.array([value(e) for e in played]) - truth) for name, played in models.items()}
        row: dict[str, Any] = {"unit": unit, "plant": _interval(truth.mean(), truth[draws].mean(axis=1))}
        row["error"] = {name: _interval(d.mean(), d[draws].mean(axis=1)) for name, d in off.items()}
        row["ratio"] = {name: _ratio(d, off[first], draws) for name, d in off.items() if name != first}
        out["measures"][measure] = row
    return out


def _ratio(d: np.ndarray, base: np.ndarray, draws: np.ndarray) -> dict[str, float | None]:
    below = base[draws].mean(axis=1)
    known = below > ROUNDED
    if base.mean() <= ROUNDED or not known.any():
        return {"value": None, "low": None, "high": None}
    return _interval(d.mean() / base.mean(), d[draws].mean(axis=1)[known] / below[known])


def _interval(value: float, drawn: np.ndarray) -> dict[str, float | None]:
    low, high = np.quantile(drawn, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return {"value": float(value), "low": float(low), "high": float(high)}


def markdown(found: Mapping[str, Mapping[str, Any]], first: str) -> str:
    """Return the table of several {policy: errors}: a row a policy and model, the plant's own numbers first."""
    head = ["policy", "in", *(f"{m}, {unit}" for m, (_, unit) in MEASURES.items()), "success"]
    lines = [_line(head), _line(["---"] * len(head))]
    for policy, one in found.items():
        measures = one["measures"]
        means = [f"mean {_number(measures[m]['plant']['value'])}" for m in MEASURES]
        lines.append(_line([policy, "hidden", *means, _rate(one["success"]["plant"])]))
        for model in measures["peak force"]["error"]:
            cells = [_error(measures[m], model, first) for m in MEASURES]
            lines.append(_line([policy, model, *cells, _rate(one["success"][model])]))
    return "\n".join(lines) + "\n"


def _error(row: Mapping[str, Any], model: str, first: str) -> str:
    text = f"off by {_number(row['error'][model]['value'])}"
    ratio = row["ratio"].get(model)
    if model == first or ratio is None or ratio["value"] is None:
        return text
    return f"{text}: {ratio['value']:.2f} ({ratio['low']:.2f} to {ratio['high']:.2f}) times {first}"


def _rate(e: Mapping[str, Any]) -> str:
    return f"{100 * e['value']:.0f} % of {e['n']}"


def _number(value: float) -> str:
    return f"{value:.3g}"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
