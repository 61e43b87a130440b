"""Makes the recordings of cases: two to fit and one to validate, each 5 s at 500 Hz."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from arm import Arm, rigid
from cases import Case
from folder import write
from loop import RATE, Run, simulate

from vispeg.core.seeds import stream
from vispeg.identify.excitation import Motion, motion

DURATION = 5.0  # s
RECORDINGS = ("rec-1", "rec-2", "rec-3")  # the last one validates
ROWS = 24  # recordings simulated together


def motions(case: Case) -> list[Motion]:
    """Return the commanded motions of a case: Fourier, slow triangles with chirps, and one of the two anew."""
    last = ("fourier", "mix")[int(stream(case.seed, "last", case.name).integers(2))]
    names = ["osc"] * 3 if case.mode == "osc" else ["fourier", "mix", last]
    out = []
    for recording, name in zip(RECORDINGS, names, strict=True):
        options = {"model": rigid(), "reach_m": 0.12, "turn_rad": 0.35} if name == "osc" else {}
        rng = stream(case.seed, "motion", case.name, recording)
        out.append(motion(name, Arm, RATE, DURATION, rng, **options))
    return out


def folders(root: Path, case: Case) -> list[Path]:
    """Return the folders of a case's recordings; the last one validates."""
    return [root / "recordings" / case.key / name for name in RECORDINGS]


def make(root: Path, chosen: list[Case], say=print) -> None:
    """Make what is not there yet; `truth.json` beside the recordings says what is hidden where."""
    wanted = [c for c in chosen if not all((f / "samples.csv").exists() for f in folders(root, c))]
    size = max(1, ROWS // len(RECORDINGS))
    for start in range(0, len(wanted), size):
        part = wanted[start : start + size]
        runs, places = [], []
        for case in part:
            for folder, move in zip(folders(root, case), motions(case), strict=True):
                seed = int(stream(case.seed, "noise", case.name, folder.name).integers(2**31))
                runs.append(Run(case.hidden, move, case.mode, seed))
                places.append(folder)
        for folder, run, signals in zip(places, runs, simulate(runs), strict=True):
            write(folder, run.motion.time, run.mode, run.motion.name, signals)
        say(f"made {min(start + size, len(wanted))}/{len(wanted)} cases")
    root.mkdir(parents=True, exist_ok=True)
    path = root / "truth.json"
    truth = json.loads(path.read_text()) if path.exists() else {}
    for c in chosen:
        hidden = [{"effect": h.effect, "where": h.where, "params": h.params} for h in c.hidden]
        truth[c.name] = {"folder": c.key, "kind": c.kind, "mode": c.mode, "hidden": hidden}
    part_path = path.with_suffix(".part")
    part_path.write_text(json.dumps(truth, indent=1, default=np.ndarray.tolist))
    part_path.replace(path)
