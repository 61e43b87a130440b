"""Fit the true effects, and a fixed set of parameters, to a case's recordings, as references for a diagnosis.

Run as a script by the benchmark: `python reference.py FOLDER HIDDEN_JSON [--baseline]` prints one JSON object.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.identify.fit import Fit, fit_job
from vispeg.identify.inverse import evidence_for
from vispeg.identify.pool import run_together
from vispeg.recordings.load import load
from vispeg.worlds.world import World

FIXED = {"rotor_inertia": "inertia", "viscous_friction": "damping", "coulomb_friction": "torque",
         "joint_bias": "torque"}  # fmt: skip
SMALL = np.array([1.0, 1.0, 0.6, 0.6, 0.1, 0.1, 0.01])  # start of the fixed set, in the effects' own units


def fitted(world: World, folder: Path) -> tuple[Fit, float, float]:
    """Fit a world to the first two recordings.

    Returns:
        The fit, its held-out error on the third, rad RMS, and the noise floor of that.
    """
    recordings = [load(folder / f"rec-{i}") for i in (1, 2, 3)]
    evidence, judged = evidence_for(recordings[:2]), evidence_for(recordings[2:])
    (fit,) = run_together([fit_job(evidence, world, range(len(world.effects)), iterations=12)], evidence.residuals)
    return fit, judged.rms_error(judged.residuals([fit.world])[0]), judged.floor


def oracle(folder: Path, hidden: list[dict]) -> dict:
    """Return the held-out error of the true effects, fitted from the true values."""
    world = World().add(*(EffectInstance.of(h["effect"], h["where"], **h["params"]) for h in hidden))
    fit, error, floor = fitted(world, folder)
    values = {e.label: {k: v.value for k, v in e.params.items()} for e in fit.world.effects}
    return {"heldout_error": error, "floor": floor, "params": values}


def baseline(folder: Path) -> dict:
    """Fit inertia, damping, friction and bias of every joint and one delay at once; return error and largest z."""
    joints = [f"joint{i}" for i in range(1, 8)]
    placed = [EffectInstance.of(e, w, **{p: 0.1 * SMALL[j]}) for e, p in FIXED.items() for j, w in enumerate(joints)]
    world = World().add(*placed, EffectInstance.of("command_delay", "all", delay=5e-4))
    fit, error, _ = fitted(world, folder)
    best, named = -1.0, None
    for e in fit.world.effects:
        (v,) = e.params.values()
        if v.low is not None and v.high is not None and v.high > v.low:
            z = abs(v.value) / ((v.high - v.low) / 3.92)
            if z > best:
                best, named = z, [e.effect, e.where]
    return {"heldout_error": error, "named": named, "z": best}


def main() -> int:
    """Print {"oracle": .., "baseline": ..} for one case."""
    folder, hidden = Path(sys.argv[1]), json.loads(sys.argv[2])
    out = {"oracle": oracle(folder, hidden) if hidden else None}
    if "--baseline" in sys.argv:
        out["baseline"] = baseline(folder)
    print(json.dumps(out))
    return 0


if __name__ == "__main__":
    sys.exit(main())
