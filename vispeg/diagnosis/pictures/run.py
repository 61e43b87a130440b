"""Diagnose recordings with frames: find the effects of camera, sensor and arm that the model lacks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vispeg.core.effect import REGISTRY
from vispeg.core.errors import UserError
from vispeg.core.rules import RULES
from vispeg.diagnosis.beginning import opened
from vispeg.diagnosis.conclusion.shares import Share, by_label, each_left_out
from vispeg.diagnosis.findings import Rivals
from vispeg.diagnosis.pictures.borders import BorderSearch
from vispeg.diagnosis.pictures.excited import border_excitations, motion_between, not_excited
from vispeg.diagnosis.pictures.flatness import heights_left
from vispeg.diagnosis.pictures.halves import compare_halves
from vispeg.diagnosis.pictures.projection import confounded, projections
from vispeg.diagnosis.pictures.remainder import left_over, moved_most
from vispeg.diagnosis.pictures.sensors import sensor_search
from vispeg.diagnosis.pictures.show import shown_pictures
from vispeg.diagnosis.pictures.spread import confirmed
from vispeg.diagnosis.pictures.verdict import decide, with_sensor
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.record import candidates, correlations, effects, ladder, screening, with_origin
from vispeg.diagnosis.run import Diagnosis
from vispeg.diagnosis.schema import Channel, DiagnosisRecord, NextMotion, NoiseFloor
from vispeg.diagnosis.selection.state import State
from vispeg.identify.pictures.align import FREED
from vispeg.identify.pictures.build import border_evidence, seeing
from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.identify.pictures.gather import gather
from vispeg.identify.pictures.points import Points
from vispeg.identify.pictures.read import sights_of
from vispeg.identify.pictures.sight import Sight
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import Scene
from vispeg.vision.predict import Predictor
from vispeg.worlds.world import World

WIDE = 8.0  # px around a predicted border in which the remaining edge errors are measured


def diagnose_pictures(
    world: World,
    scene: Scene,
    fitted: Sequence[Recording],
    held_out: Sequence[Recording],
    *,
    seed: int = 0,
    say: Callable[[str], None] = lambda _: None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find the effects that `world` lacks, from camera images; every error in the record is on `held_out`.

    Args:
        world: the model; its effects are placed in `scene`.
        scene: the cell as it is believed.
        fitted, held_out: recordings with frames.
        seed: seed of the noise of the modelled sensor.
        say: called with a line for each stage.
        progress: stores intermediate results, so that a killed diagnosis can be resumed with the same arguments.

    Raises:
        UserError: recordings without frames or colour, cameras without a stated pose, or no camera that sees the cell.
    """
    for rec in (*fitted, *held_out):
        if not any(frame.rgb_source is not None for frame in rec.frames or ()):
            what = "its pictures have no colour, in which the edges of parts are found"
            raise UserError(what, file=rec.path, key="frames/index.csv", expected="files in the column rgb")
    (mine, theirs), blind = seeing(scene, (sights_of(fitted), sights_of(held_out)), world)
    if not mine:
        raise UserError(f"no camera sees the cell: {'; '.join(blind)}", file=fitted[0].path)
    say("aligning the predicted borders with the pictures")
    progress = Progress() if progress is None else progress
    borders = border_evidence(scene, mine, theirs, world, recall=progress.recall)
    search = BorderSearch(*borders, say, progress)
    begin = opened(world, {name for name, kind in REGISTRY.items() if "border" in kind.channels()})
    world, n_fixed = begin.world, begin.n_given
    say("fitting what moves the borders")
    state = search.run(world, n_fixed)
    if any(e.effect not in (*FREED, *borders[0].freed) for e in state.world.effects[n_fixed:]):
        borders = border_evidence(scene, mine, theirs, state.world, recall=progress.recall)
        search, state = _seen_anew(search, state, borders)
    evidence, judged = search.evidence, search.judged
    assert isinstance(evidence, BorderEvidence) and isinstance(judged, BorderEvidence)
    rivals = search.rivals(state)
    halves = compare_halves(search, (evidence, judged), state.world, n_fixed)
    state = confirmed(search, state)
    cameras = list({s.camera.name: s.camera for s in (*mine, *theirs)}.values())
    say("looking for what is left")
    with Predictor(scene, cameras) as predictor:
        wide = [[(s, gather(predictor, s, state.world, WIDE)) for s in group] for group in (mine, theirs)]
        bent = heights_left(predictor.geometry, mine, theirs, state.world)
    remainder = [*bent, *left_over(wide[0], wide[1], [*scene.parts, "board"])]
    moved = moved_most(judged.geometry, wide[0], wide[1], state.world)
    (before, after), lost = judged.errors([world, state.world]), _lost(wide[1])
    n_added = len(state.world.effects) - n_fixed
    field = evidence.scatter.field
    of_borders = decide(before, after, judged.floor, n_added, rivals, remainder, halves, lost, moved, field)
    sensed = []
    if of_borders.verdict != "unexplained":  # sensor effects can be identified only once the geometry fits
        sensed = sensor_search(scene, (mine, theirs), (evidence, judged), world, state.world, say, progress)
    explained = _explained(judged, state.world, n_fixed, before, after)
    for s in sensed:
        explained |= s.explained
    alike = confounded(judged, state.world, rivals)
    verdict, rivals = with_sensor(of_borders, sensed), [*rivals, *(r for s in sensed for r in s.rivals)]
    fitted_world = state.world.add(*(e for s in sensed for e in s.added))
    final = with_origin(
        replace(state.world, cell=world.cell), n_fixed, fitted, held_out, before, after, verdict.partial
    )
    for s in sensed:
        given = len(world.effects)
        sensor_world = with_origin(s.state.world, given, fitted, held_out, s.errors[0], s.errors[1], verdict.partial)
        final = final.add(*sensor_world.effects[given:])
    with Predictor(scene, cameras) as predictor:
        drawn = shown_pictures(predictor, theirs, world, final, judged, seed)
    maps = projections(judged.geometry, world, final, state.fit)
    rungs, floor = ladder(evidence, judged, state, world), _floor(evidence, judged)
    of, found = "borders", [s for s in sensed if s.added]
    if not n_added and found:
        (rungs, floor), of = found[0].ladder(), found[0].kind
    excitations = [*border_excitations(search, state.world), *(x for s in sensed for x in s.excitations)]
    record: DiagnosisRecord = {
        "format": "vispeg-diagnosis/1",
        "verdict": verdict.verdict,
        "reason": verdict.reason + _joints_said(evidence.robot, fitted),
        "effects": effects(final, n_fixed, rivals, fitted_world, explained),
        "ladder": rungs,
        "of": of,
        "noise_floor": floor,
        "where_it_fails": [],
        "residual_peaks": [],
        "unexplained": verdict.unexplained,
        "channels": [_channel(judged, before, after), *(s.channel for s in sensed)],
        "next_experiment": _next(rivals),
        "candidates": [
            c for x in (state, *(s.state for s in sensed)) for c in candidates(x, rivals if x is state else ())
        ],
        "recordings": {"fit": [r.name for r in fitted], "validate": [r.name for r in held_out]},
        "screening": [{"effect": s.key[0], "where": s.key[1], "score": round(s.gain, 2)} for s in screening(state)],
        "correlations": correlations(state),
        "parameters_moved": [],
        "windows": [],
        "notes": [*blind, *_notes(evidence, lost)],
        "shows_from": [*search.shows_from(state), *(row for s in sensed for row in s.shows_from)],
        "views": {
            "cameras": [c.name for c in cameras],
            "frames": {"fit": sum(map(len, mine)), "validate": sum(map(len, theirs))},
            "robot_rad": evidence.robot,
            "field_px": field,
            "borders": {"fit": evidence.count, "validate": judged.count, "without_edge": round(lost, 3)},
            "projection": [p.as_dict() for p in maps],
            "confounded": alike,
            "halves": None if halves is None else {"px": halves.difference, "uncertainty_px": halves.uncertainty},
            "remainder": [{"input": x.input, "where": x.where, "share": x.share, "px": x.size} for x in remainder],
            "sensor": [s.as_dict() for s in sensed],
            "not_excited": not_excited(excitations),
        },
    }
    arrays: dict[str, np.ndarray] = {"joints": np.array(scene.joints), "unit": np.array("px")} | drawn
    for k, p in enumerate(maps):
        arrays |= {f"projection/{k}/{key}": getattr(p, key) for key in ("pixels", "shift", "sigma")}
    return Diagnosis(record, final, arrays)


def _explained(judged: BorderEvidence, world: World, n_fixed: int, before: float, after: float) -> dict[str, Share]:
    """Return what each added effect explains of the error of the borders, by its label.

    As in the verdict, a squared error is that of the misplacement in px over the floor. `before` and `after` are the
    misplacements by the user's model and by the final one, `world`.
    """
    floor = judged.floor
    times = [error / floor for error in judged.errors(each_left_out(world, n_fixed))]
    return by_label(world, n_fixed, times, [t**2 for t in times], (before / floor) ** 2, (after / floor) ** 2)


def _lost(wide: Sequence[tuple[Sight, Points]]) -> float:
    """Return the share of predicted border points without a measured edge within `WIDE`."""
    away = np.concatenate([p.along for _, p in wide])
    return 1.0 - float(np.isfinite(away).mean()) if len(away) else 0.0


def _seen_anew(
    search: BorderSearch, state: State, evidence: tuple[BorderEvidence, BorderEvidence]
) -> tuple[BorderSearch, State]:
    """Repeat edge matching with the effects found so far; return the search and the state on the new edges.

    An effect that the alignment does not fit (a read-out time, say) is first mistaken for joint errors, and its edges
    for outliers.
    """
    anew = BorderSearch(*evidence, search.say, search.progress)
    (fit,) = anew.fits([state.world], state.n_fixed)
    state.take(fit, anew.judge.losses([fit.world])[0])
    return anew, replace(state, last=[])


def _floor(evidence: BorderEvidence, judged: BorderEvidence) -> NoiseFloor:
    return {"value": judged.floor, "unit": "px RMS", "from": evidence.floor_from}


def _joints_said(robot: float, recordings: Sequence[Recording]) -> str:
    """Return a clause on the joint error assumed in each frame, compared with the recordings' stated encoder noise."""
    if not robot:
        return ""
    text = f"; this assumes joint errors of {1e3 * robot:.2g} mrad in each frame (1 sigma), estimated from the pictures"
    stated = max((float(rec.noise.get("q", 0.0)) for rec in recordings), default=0.0)
    return text + (f", {robot / stated:.0f} times the encoders' stated noise" if robot > stated > 0 else "")


def _channel(judged: BorderEvidence, before: float, after: float) -> Channel:
    """Return the record's entry on the borders; errors are RMS px on the held-out pictures."""
    cameras = " and ".join(dict.fromkeys(i.sight.camera.name for i in judged.items))
    return {
        "channel": "border",
        "joint": cameras,
        "floor": judged.floor,
        "before": before,
        "after": after,
        "unit": "px RMS",
    }


def _next(rivals: Sequence[Rivals]) -> NextMotion | None:
    """Return the motion that would distinguish the first effect with equals from these; None if no effect has any."""
    for r in rivals:
        if r.equals:
            others = [t.score.placed.effect for t in r.equals]
            motion = motion_between(r.label.split("(")[0], others)
            why = f"tells {r.label} from {', '.join(t.score.label for t in r.equals)}"
            return {"motion": motion, "why": why}
    return None


def _notes(evidence: BorderEvidence, lost: float) -> list[str]:
    """Return messages for the user; `lost` is the share of predicted borders without an edge."""
    out = list(evidence.notes)
    if lost > 0.2:
        out.append(
            f"{100 * lost:.0f} % of the predicted borders have no clear edge in the pictures: too alike in colour"
        )
    if lost > RULES.lost and any(i.sight.depth(0) is None for i in evidence.items):
        out.append("depth in every frame would let larger camera errors be found, and more reliably, than colour alone")
    return out
