"""`vispeg fit --protocol paper`: the sub-trajectory protocol of `vispeg.identify.paper` on recordings."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from vispeg.cli.fit import Args


def run_paper(args: Args) -> int:
    """Fits one recording, judges on the held-out ones, writes fit.json, model.yaml and paths.png."""
    from vispeg.cli.inputs import read_inputs
    from vispeg.core.errors import UserError
    from vispeg.core.files import new_folder
    from vispeg.core.provenance import provenance
    from vispeg.core.seeds import stream
    from vispeg.identify.checkpoint import Checkpoint
    from vispeg.identify.paper import GENERATIONS, cost, cut, fit_paper, paths
    from vispeg.report.signature import signature_panels
    from vispeg.report.write import write_json
    from vispeg.worlds.model_file import model_text, placed_dict

    if args.effects:
        raise UserError("the paper's protocol has its own parameters", key="--effects", expected="none")
    world, fitted, held_out = read_inputs(args.model, args.recording, args.validate, False, 0.0, None)
    if len(fitted) != 1:
        raise UserError("the paper's protocol fits one recording", key="--recording", expected=1, got=len(fitted))
    pieces = {rec.name: cut(rec) for rec in (*fitted, *held_out)}
    stamp = provenance(sys.argv, args.seed, [*args.recording, *args.validate])
    part = args.out.with_name(args.out.name + ".part")
    key = ["paper", model_text(world), args.seed, stamp["inputs"], stamp["versions"]]
    read = (args.model, world.robot, *args.recording, *args.validate)
    with new_folder(args.out, overwrite=args.overwrite, holds="fit", inputs=read) as folder:
        steps = args.iterations or GENERATIONS
        with _following(steps, args.quiet) as told:
            checkpoint = Checkpoint(part / "checkpoint.json", key, 1, args.resume, told)
            trace, rng = checkpoint.traces[0], stream(args.seed, "fit", "paper")
            options = {"generations": steps, "nthread": args.threads, "trace": trace}
            final = fit_paper(world, pieces[fitted[0].name], rng=rng, **options)
        rows: list[dict[str, Any]] = []
        for name, piece in pieces.items():
            before, after = paths(piece, [world, final], args.threads)
            gaps = [np.linalg.norm(piece.measured - y, axis=-1) for y in (before, after)]
            row: dict[str, Any] = {"recording": name, "fitted": name == fitted[0].name}
            row |= {"cost_before": cost(piece, before), "cost_after": cost(piece, after), "unit": "m"}
            row |= {"rms_before": _rms(gaps[0]), "rms_after": _rms(gaps[1])}
            rows.append(row)
            shown = {"measured": piece.measured, "before": before, "after": after}
            panels = [
                ("m", {f"{a} {k}": y.reshape(-1, 3)[:, i] for k, y in shown.items()}) for i, a in enumerate("xyz")
            ]
            panels.append(("m", {"distance after": gaps[1].ravel(), "distance before": gaps[0].ravel()}))
            title = f"{name}: flange in {len(gaps[0])} sub-trajectories"
            signature_panels(title, piece.time, panels, folder / f"paths-{name}.png")
        effects = [e for e in final.effects if e not in world.effects]
        record = {
            "format": "vispeg-fit/1",
            "protocol": "paper",
            "method": "cma",
            "effects": [placed_dict(e) for e in effects],
            "recordings": rows,
            "provenance": stamp,
        }
        write_json(folder / "fit.json", record)
        (folder / "model.yaml").write_text(model_text(final), encoding="utf-8")
    checkpoint.remove()
    _print(args, rows, effects)
    return 0


def _rms(gap: np.ndarray) -> float:
    return float(np.sqrt(np.mean(gap**2)))


def _following(generations: int, quiet: bool):
    from contextlib import contextmanager

    from rich.console import Console
    from rich.progress import Progress

    @contextmanager
    def bars():
        with Progress(console=Console(stderr=True), transient=True, disable=quiet) as progress:
            bar = progress.add_task("generations", total=generations)
            yield lambda i, trace: progress.update(
                bar, completed=len(trace.generations), description=f"cost {trace.cost:.4g} m"
            )

    return bars()


def _print(args: Args, rows: list[dict[str, Any]], effects: list[Any]) -> None:
    from vispeg.core.effect import effect
    from vispeg.report.quantities import quantity

    for row in rows:
        role = "fitted" if row["fitted"] else "held out"
        fall = f"{quantity(row['rms_before'], 'm RMS')} -> {quantity(row['rms_after'], 'm RMS')}"
        print(f"{row['recording']} ({role}): cost {row['cost_before']:.4g} -> {row['cost_after']:.4g} m; flange {fall}")
    for e in effects:
        values = ", ".join(f"{k} {v.value:.3g} {effect(e.effect).params[k].unit}" for k, v in e.params.items())
        print(f"  {e.label}: {values}")
    pictures = [str(args.out / f"paths-{row['recording']}.png") for row in rows]
    print(f"pictures: {', '.join(pictures)}")
