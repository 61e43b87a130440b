"""`vispeg.diagnose` for a free object: read its model and tosses, and find what its contact lacks."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vispeg.channels.channel import CHANNELS, How
from vispeg.core.errors import UserError
from vispeg.core.provenance import Provenance, digest, here
from vispeg.core.several import each_once, several
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.run import Diagnosis
from vispeg.recordings.objects import ObjectRecording, load_object_recording
from vispeg.robots import resources
from vispeg.robots.objects import is_object, load_object
from vispeg.sim.placement import activate
from vispeg.worlds.model_file import load_model, model_text
from vispeg.worlds.world import World


def object_world(model: World | str | Path) -> World | None:
    """Return the world of a model whose robot is a free object; None for other models."""
    if isinstance(model, World):
        return model if is_object(model.robot) else None
    if Path(model).suffix.lower() in (".yaml", ".yml") and Path(model).is_file():
        world = load_model(model)
        return world if is_object(world.robot) else None
    return World(robot=str(model)) if is_object(model) else None


@dataclass(frozen=True)
class Tosses:
    """A diagnosis of an object, the files that were read, its provenance, and its saved progress."""

    result: Diagnosis
    files: tuple[str | Path, ...]
    provenance: Provenance
    progress: Progress | None = None


def diagnose_tosses(
    world: World,
    recordings: object,
    validate: object,
    seed: int,
    threads: int,
    say: Callable[[str], None],
    part: Path | None,
) -> Tosses:
    """Name the effects that an object's contact lacks.

    Arguments are as for `vispeg.diagnose`; `part` is the folder that keeps finished steps.

    Raises:
        UserError: no recordings, one on both sides, of another object, or effects that have no place on it.
    """
    fit, judge = several(recordings), several(validate)
    for key, sources in (("--recording", fit), ("--validate", judge)):
        if not sources:
            raise UserError("no recording given", key=key, expected="at least one folder of an object's tosses")
        each_once((Path(s) for s in sources if isinstance(s, str | Path)), key)
    model = load_object(world.robot)
    activate(model, [world])  # raises for an effect that has no place here
    fitted, held_out = ([_read(s) for s in sources] for sources in (fit, judge))
    for held in held_out:
        for rec in fitted:
            if np.array_equal(held.pose, rec.pose):
                raise UserError(f"a copy of {rec.path}, which is fitted", file=held.path, expected="other tosses")
    paths = [r.path for r in (*fitted, *held_out)]
    stamp = here(seed, {str(p): f"sha256:{digest(p)}" for p in paths if p.exists()})
    progress = None
    if part is not None:
        read = [[hashlib.sha256(r.pose.tobytes()).hexdigest() for r in group] for group in (fitted, held_out)]
        progress = Progress(
            part / "progress.json", [model_text(world), resources.digest(world.robot), read, seed, stamp["versions"]]
        )
    say("going on" if progress is not None and progress.resumed else "simulating")
    how = How(seed=seed, threads=threads, say=say, progress=Progress() if progress is None else progress)
    result = CHANNELS["tosses"].diagnose(world, (fitted, held_out), how)  # type: ignore[arg-type]  # this channel's are ObjectRecording
    return Tosses(result, (world.robot, *(p for p in paths if p.exists())), stamp, progress)


def _read(source: object) -> ObjectRecording:
    if isinstance(source, str | Path):
        return load_object_recording(source)
    if isinstance(source, ObjectRecording):
        return source
    raise UserError("no recording of an object", expected="a folder of its tosses", got=type(source).__name__)
