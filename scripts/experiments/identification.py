"""Identifies a hidden plant by `vispeg record` and `vispeg diagnose`, and makes a training world of what was found."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import yaml

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.robots.model import load
from vispeg.robots.scene import build
from vispeg.task.world_file import FORMAT, load_world
from vispeg.worlds.entry import entry_dict
from vispeg.worlds.identified import Identified, ranges_of
from vispeg.worlds.model_file import model_text
from vispeg.worlds.world import World

ROBOT, TOOL = "iiwa14", "meg50+peg16"
FITTED, JUDGED = (1, 2), 3  # motion seeds
MOTION = ("--motion", "fourier", "--duration", "5", "--noise", "q=2e-5", "dq=1e-3", "tau=0.1")
LATENCY = 0.006  # s, of the position interface: with the arm's usual gains, 14 ms would make the servo oscillate


def arm_of(world: str | Path) -> World:
    """Return the arm, with its tool, that a world of fixed effects hides; what only the task's scene has is left out.

    Latency belongs to the way of commanding: the recordings have `LATENCY` where the world has one for torques.
    """
    arm = load(ROBOT, tool=TOOL)
    drawn = load_world(world).world.sample(seed=0, model=build())
    hidden = World(ROBOT, TOOL, tuple(e for e in drawn.effects if effect(e.effect).targets(arm)))
    late = any(e.effect == "command_delay" for e in hidden.effects)
    return hidden.add(EffectInstance.of("command_delay", "all", delay=LATENCY)) if late else hidden


def identify(world: str | Path, folder: Path) -> Path:
    """Return the model.yaml that a diagnosis of the plant's recordings wrote; made where it is not there yet.

    The diagnosis is given the recordings and the nominal arm with its tool. Both lie in `folder`.
    """
    found = folder / "found" / "model.yaml"
    if found.is_file():
        return found
    folder.mkdir(parents=True, exist_ok=True)
    plant, nominal = folder / "plant.yaml", folder / "nominal.yaml"
    write_text_atomic(plant, model_text(arm_of(world)), overwrite=True)
    write_text_atomic(nominal, model_text(World(ROBOT, TOOL)), overwrite=True)
    taken = [folder / f"recording-{seed}" for seed in (*FITTED, JUDGED)]
    for seed, place in zip((*FITTED, JUDGED), taken, strict=True):
        if not place.is_dir():
            _vispeg("record", str(plant), *MOTION, "--seed", str(seed), "--out", str(place))
    shown = [word for place in taken[:-1] for word in ("--recording", str(place))]
    judged = ("--validate", str(taken[-1]), "--threads", "1", "--quiet", "--overwrite")
    _vispeg("diagnose", str(nominal), *shown, *judged, "--out", str(found.parent))
    return found


def identified_world(model: Path, base: str, path: Path) -> Path:
    """Write the world file `base` in which what was identified takes the place of the ranges at the same places.

    The same as `base` and `model` together, but written out, so that the file stands by itself among the results.

    Raises:
        UserError: nothing was identified, so that the world would be its base under another name.
    """
    entries = [entry_dict(r) for r in ranges_of(Identified(model), ROBOT)]
    if not entries:
        raise UserError("the diagnosis named no effect, so there is nothing to train about", file=model)
    about = f"{base}, with what a diagnosis of the plant found: fitted values as centres, their intervals as widths."
    data: dict[str, Any] = {"format": FORMAT, "name": path.stem, "about": about, "base": base, "effects": entries}
    return write_text_atomic(path, yaml.safe_dump(data, sort_keys=False), overwrite=True)


def told(model: Path) -> dict[str, Any]:
    """Return the diagnosis behind a model.yaml in short: verdict, reason, and the held-out error before and after."""
    record = json.loads(model.with_name("diagnosis.json").read_text(encoding="utf-8"))
    ladder = record["ladder"]
    found = {"verdict": record["verdict"], "reason": record["reason"], "noise_floor": record["noise_floor"]}
    return found | {"heldout_error": [ladder[0]["heldout_error"], ladder[-1]["heldout_error"]]}


def _vispeg(*words: str) -> None:
    subprocess.run([sys.executable, "-m", "vispeg", *words], check=True)
