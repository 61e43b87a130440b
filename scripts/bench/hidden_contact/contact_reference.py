"""Fit the true effects: no diagnosis can lower the held-out error further, except by chance.

Run as a script by the benchmark: `python contact_reference.py JUDGE HIDDEN_JSON FIT..` prints one JSON object.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from vispeg.contact.evidence import ContactEvidence
from vispeg.contact.record import phase_errors
from vispeg.contact.run import evidence_of
from vispeg.core.effect import EffectInstance
from vispeg.identify.fit import fit_job
from vispeg.identify.pool import run_together
from vispeg.recordings.load import load
from vispeg.worlds.world import World

ITERATIONS = 6  # as a search has


def reference(judge: Path, hidden: list[dict], fit: list[Path]) -> dict:
    """Return the held-out errors, N RMS, of the nominal model and of the true effects, fitted from their true values.

    `before` and `after` are as in a diagnosis' ladder, `plain_before` and `plain_after` of plain forces in all phases.
    """
    evidence, judged = evidence_of([load(f) for f in fit]), evidence_of([load(judge)])
    world = World().add(*(EffectInstance.of(h["effect"], h["where"], **h["params"]) for h in hidden))
    job = fit_job(evidence, world, range(len(world.effects)), iterations=ITERATIONS)
    (found,) = run_together([job], evidence.residuals)
    return errors(judged, World(), found.world)


def errors(judged: ContactEvidence, before: World, after: World) -> dict:
    """Return the errors of two models as in `reference`."""
    phases = phase_errors(judged, judged.simulated([before, after]))
    out = {}
    for key, world in (("before", before), ("after", after)):
        out[key] = judged.rms_error(judged.residuals([world])[0])
        total = sum(float(p["seconds"]) * float(p[key]) ** 2 for p in phases)
        out[f"plain_{key}"] = (total / sum(float(p["seconds"]) for p in phases)) ** 0.5
    return out


if __name__ == "__main__":
    print(json.dumps(reference(Path(sys.argv[1]), json.loads(sys.argv[2]), [Path(f) for f in sys.argv[3:]])))
