"""Hidden plants for the transfer experiment: the bundled one, and others drawn by number, each the same everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vispeg.core.files import write_text_atomic
from vispeg.core.seeds import stream
from vispeg.task.world_file import BUILT_IN, FORMAT

BUNDLED = BUILT_IN / "parts" / "plant.yaml"
JOINTS = [f"joint{j}" for j in range(1, 8)]
# N m, of a joint at strength 1: what harmonic drives of its size have
DRY = np.array([1.6, 1.6, 1.0, 1.0, 0.5, 0.3, 0.3])
SOURCE = "held out: drawn by scripts/experiments/plants.py"


def hidden_plant(number: int, folder: Path) -> Path:
    """Return the world file of plant `number`: 0 is the bundled one, any other is written into `folder`.

    What is drawn: how strong all is (half to one and a half of the bundled plant's size), friction in three to seven
    joints, one gain, one encoder, a payload, latency in half of the plants; and the tilt, grip, contact and peg.
    """
    if number == 0:
        return BUNDLED
    rng = stream(number, "hidden plant")
    strength = rng.uniform(0.5, 1.5)
    effects = [*_arm(rng, strength), *_cell(rng, strength)]
    about = f"Hidden plant {number}: {strength:.2f} times the strength of the bundled one."
    name, base = f"plant-{number}", str(BUNDLED.with_name("goal.yaml"))
    data = {"format": FORMAT, "name": name, "about": about, "base": base, "effects": effects}
    return write_text_atomic(folder / f"{name}.yaml", yaml.safe_dump(data, sort_keys=False), overwrite=True)


def _arm(rng: np.random.Generator, strength: float) -> list[dict[str, Any]]:
    dry = rng.choice(7, size=rng.integers(3, 8), replace=False)
    out = [
        _effect("coulomb_friction", JOINTS[j], torque=strength * float(DRY[j]) * rng.uniform(0.4, 1.0))
        for j in sorted(dry)
    ]
    out += [_effect("viscous_friction", joint, damping=strength * rng.uniform(0.5, 2.5)) for joint in JOINTS]
    out.append(_effect("torque_gain", rng.choice(JOINTS), gain=1.0 + strength * rng.uniform(-0.06, 0.06)))
    out.append(_effect("encoder_offset", rng.choice(JOINTS), offset=strength * rng.uniform(-0.0015, 0.0015)))
    out.append(_effect("payload", "flange", mass=strength * rng.uniform(0.1, 0.45), x=0.01, z=rng.uniform(0.02, 0.08)))
    if rng.uniform() < 0.5:
        out.append(_effect("command_delay", "all", delay=strength * rng.uniform(0.004, 0.01)))
    return out


def _cell(rng: np.random.Generator, strength: float) -> list[dict[str, Any]]:
    turn, shift = (lambda: strength * rng.uniform(-0.01, 0.01)), (lambda: strength * rng.uniform(-3e-4, 3e-4))
    return [
        _effect("hole_tilt", "fixture", roll=turn(), pitch=turn()),
        _effect("grip_pose", "peg", x=shift(), y=shift(), roll=turn(), pitch=turn()),
        _effect("contact_friction", "peg", scale=1.0 + strength * rng.uniform(0.2, 0.6)),
        _effect("contact_stiffness", "peg", scale=0.3**strength),
        _effect("object_mass", "peg", scale=1.0 + strength * rng.uniform(-0.3, 0.4)),
    ]


def _effect(name: str, where: str, **params: float) -> dict[str, Any]:
    values = {key: float(f"{value:.4g}") for key, value in params.items()}
    return {"effect": name, "where": str(where), "params": values, "source": SOURCE}
