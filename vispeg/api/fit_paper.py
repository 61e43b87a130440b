"""Fit by the paper's protocol (`vispeg.identify.paper.protocol`), as `vispeg fit --protocol paper` does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.api.inputs import Model, Source, read_inputs
from vispeg.api.result import Result
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.params import Value
from vispeg.core.seeds import stream
from vispeg.identify.checkpoint import Checkpoint, Trace
from vispeg.identify.paper import protocol
from vispeg.identify.paper.intervals import determine
from vispeg.recordings.progress import Reading, silent
from vispeg.report.drawings.signature import signature_panels
from vispeg.report.text.quantities import quantity
from vispeg.report.text.summary import Block, Line
from vispeg.report.write import finite, write_json
from vispeg.worlds.model_file import model_text, placed_dict, write_model
from vispeg.worlds.world import World


@dataclass(frozen=True, repr=False)
class PaperFit(Result):
    """Link masses, damping and gravity fitted to the flange's path.

    Attributes:
        record: content of fit.json.
        world: the model with the fitted values.
        effects: the fitted effects.
        paths: recording -> (time (n,) s, {"measured", "before", "after"} -> (npiece, nstep, 3) m).
        sources: files and folders that were read.
    """

    record: Mapping[str, Any]
    world: World
    effects: tuple[EffectInstance, ...]
    paths: Mapping[str, tuple[np.ndarray, Mapping[str, np.ndarray]]] = field(repr=False)
    sources: tuple[str | Path, ...] = ()
    _checkpoint: Checkpoint | None = field(default=None, repr=False)
    holds = "fit"  # class attribute, see `Result`

    @property
    def summary(self) -> list[Block]:
        """Cost and flange error of each recording before and after, the fitted values, and undetermined parameters."""
        out: list[Block] = []
        for row in self.record["recordings"]:
            role = "fitted" if row["fitted"] else "held out"
            fall = f"{quantity(row['rms_before'], 'm RMS')} -> {quantity(row['rms_after'], 'm RMS')}"
            cost = f"cost {row['cost_before']:.4g} -> {row['cost_after']:.4g} m"
            out.append(Line(f"{row['recording']} ({role}): {cost}; flange {fall}"))
        for e in self.effects:
            values = ", ".join(_stated(k, v, effect(e.effect).params[k].unit) for k, v in e.params.items())
            out.append(Line(f"  {e.label}: {values}"))
        if self.record["undetermined"]:
            names = ", ".join(self.record["undetermined"])
            out.append(Line(f"not determined by this recording (interval holds null and more): {names}"))
        return out

    def save(self, out: str | Path, *, overwrite: bool = False) -> Path:
        """Write fit.json, model.yaml and a picture of each recording's path; see `Result.save`."""
        path = super().save(out, overwrite=overwrite)
        if self._checkpoint is not None:
            self._checkpoint.remove()
        return path

    def _write(self, folder: Path) -> None:
        for name, (time, lines) in self.paths.items():
            errors = {k: _distance(lines["measured"], lines[k]) for k in ("before", "after")}
            panels = [
                ("m", {f"{a} {k}": y.reshape(-1, 3)[:, i] for k, y in lines.items()}) for i, a in enumerate("xyz")
            ]
            panels.append(("m", {f"distance {k}": errors[k].ravel() for k in ("after", "before")}))
            title = f"{name}: flange in {len(lines['measured'])} sub-trajectories"
            signature_panels(title, time, panels, folder / f"paths-{name}.png")
        write_json(folder / "fit.json", dict(self.record))
        write_model(folder / "model.yaml", self.world)


def fit_paper(
    model: Model,
    recording: Source,
    validate: Source | Sequence[Source] = (),
    *,
    iterations: int | None = None,
    seed: int = 0,
    threads: int = 2,
    part: str | Path | None = None,
    resume: bool = False,
    watch: Callable[[int, Trace], None] = lambda start, trace: None,
    reading: Reading = silent,
) -> PaperFit:
    """Fit link masses, joint damping and the direction of gravity by CMA-ES to the flange's path in sub-trajectories.

    Args:
        model, validate, seed, threads, part, resume, watch, reading: as in `vispeg.fit`.
        recording: one recording under operational space control.
        iterations: number of CMA-ES generations; default: 120.

    Raises:
        UserError: another controller, a recording that is too short or cannot be read.
    """
    iterations = protocol.GENERATIONS if iterations is None else iterations
    if iterations < 1:
        raise UserError("nothing to fit", key="--iterations", expected="1 or more", got=iterations)
    options = {"need_validate": False, "seconds": 0.0, "signals": None, "reading": reading}
    inputs = read_inputs(model, recording, validate, **options)
    if len(inputs.fitted) != 1:
        raise UserError(
            "the paper's protocol fits one recording", key="--recording", expected=1, got=len(inputs.fitted)
        )
    pieces = {rec.name: protocol.cut(rec) for rec in (*inputs.fitted, *inputs.held_out)}
    fitted, world, stamp = inputs.fitted[0].name, inputs.world, inputs.provenance(seed)
    checkpoint = None
    if part is not None:
        key = ["paper", model_text(world), seed, stamp["inputs"], stamp["versions"]]
        checkpoint = Checkpoint(Path(part) / "checkpoint.json", key, 1, resume, watch)
    trace = checkpoint.traces[0] if checkpoint is not None else None
    rng = stream(seed, "fit", "paper")
    best = protocol.fit_paper(world, pieces[fitted], rng=rng, generations=iterations, nthread=threads, trace=trace)
    determined = determine(protocol.Coordinates(world, pieces[fitted]), pieces[fitted], best, threads)
    final = determined.world
    rows, lines = [], {}
    for name, piece in pieces.items():
        before, after = protocol.paths(piece, [world, final], threads)
        lines[name] = piece.time, {"measured": piece.measured, "before": before, "after": after}
        row: dict[str, object] = {"recording": name, "fitted": name == fitted, "unit": "m"}
        row |= {"cost_before": protocol.cost(piece, before), "cost_after": protocol.cost(piece, after)}
        known = np.isfinite(piece.measured).all(axis=-1)
        rms = [float(np.sqrt(np.mean(_distance(piece.measured, y)[known] ** 2))) for y in (before, after)]
        rows.append(row | {"rms_before": rms[0], "rms_after": rms[1]})
    effects = tuple(e for e in final.effects if e not in world.effects)
    record = {
        "format": "vispeg-fit/1",
        "protocol": "paper",
        "method": "cma, then Gauss-Newton",
        "effects": [placed_dict(e) for e in effects],
        "undetermined": list(determined.undetermined),
        "recordings": rows,
        "provenance": stamp,
    }
    return PaperFit(finite(record), final, effects, lines, inputs.files, checkpoint)


def _stated(name: str, value: Value, unit: str) -> str:
    """Return a value with its interval as text, such as `mass 0.213 [0.198, 0.266] kg`."""
    ends = "" if value.low is None or value.high is None else f" [{value.low:.3g}, {value.high:.3g}]"
    return f"{name} {value.value:.3g}{ends} {unit}"


def _distance(measured: np.ndarray, path: np.ndarray) -> np.ndarray:
    return np.linalg.norm(measured - path, axis=-1)
