#!/usr/bin/env python3
"""Makes the bundled recordings, assets/recordings/{rig-a,rig-b,rig-c}: a robot with friction and a payload.

    python scripts/make_recordings.py [--out FOLDER]

The robot is the hidden plant of scripts/bench/hidden_effects, which shares no code with the project's own effects and
simulation, so that the demo diagnoses a robot which it did not simulate itself. `truth.json` says what is hidden.
A recording that breaks a limit of the robot is not written.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent / "bench/hidden_effects"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import pyarrow as pa
import pyarrow.parquet as pq
from arm import Arm
from folder import write as write_csv
from hidden import Hide
from loop import RATE, Run, simulate

from vispeg.api.recording.check import limits_of
from vispeg.core.files import new_folder
from vispeg.core.seeds import stream
from vispeg.identify.excitation import motion
from vispeg.recordings.checks.check import check
from vispeg.recordings.load import load
from vispeg.recordings.recording import Recording
from vispeg.recordings.write import write

SEED, SECONDS = 14, 5.0
ASSETS = Path(__file__).resolve().parents[1] / "assets"
HIDDEN = (
    Hide("coulomb_friction", "joint4", {"torque": 1.2}),
    Hide("payload", "flange", {"mass": 0.6, "x": 0.01, "y": 0.0, "z": 0.06}),
)
# The motion, and the share of the speed limits for which it is planned: the loop is soft, so that the arm overshoots
# its command, up to twofold near its resonance.
RIGS = {"rig-a": ("fourier", 0.75), "rig-b": ("mix", 0.4), "rig-c": ("fourier", 0.9)}


def main() -> int:
    """Make the three folders and truth.json."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ASSETS / "recordings")
    out = parser.parse_args().out
    motions = {rig: motion(name, _paced(pace), RATE, SECONDS, stream(SEED, rig)) for rig, (name, pace) in RIGS.items()}
    runs = [Run(HIDDEN, m, "position", int(stream(SEED, "noise", rig).integers(2**31))) for rig, m in motions.items()]
    readme = out / "README.md"
    words = readme.read_text(encoding="utf-8") if readme.is_file() else ""
    with new_folder(out, overwrite=True, holds=None) as part:
        for (rig, m), signals in zip(motions.items(), simulate(runs), strict=True):
            write_csv(part / rig, m.time, "position", m.name, signals)
            rec = replace(load(part / rig), notes="simulated by a program that shares no code with vispeg's effects")
            refuse_broken_limits(rec)
            write(rec, part / rig, overwrite=True, table="parquet")
            shrink(part / rig / "samples.parquet")
        hidden = [{"effect": h.effect, "where": h.where, "params": h.params} for h in HIDDEN]
        (part / "truth.json").write_text(json.dumps({"robot": "iiwa14", "hidden": hidden}, indent=1) + "\n")
        if words:
            (part / "README.md").write_text(words, encoding="utf-8")
    print(f"{out}: {', '.join(RIGS)}, {sum(f.stat().st_size for f in out.rglob('*') if f.is_file()) / 1e6:.2f} MB")
    return 0


def _paced(pace: float) -> Any:
    """Return the arm for planning, with its speed limits multiplied by `pace`."""
    return type("Paced", (Arm,), {"velocity_limit": pace * Arm.velocity_limit})


def refuse_broken_limits(rec: Recording) -> None:
    """Raise RuntimeError if a recording exceeds the robot's limits, which a real controller would not allow."""
    broken = [
        j.name
        for j in check(rec, limits_of(rec)).joints
        if j.outside_range or j.over_velocity or j.over_torque or j.saturated
    ]
    if broken:
        raise RuntimeError(f"{rec.name} breaks limits of {', '.join(broken)}: lower its pace")


def shrink(file: Path) -> None:
    """Rewrite a table in single precision (1e-7 rad, far under the noise), well compressed: a third of the size."""
    table = pq.read_table(file)
    narrow = {n: table[n] if n == "time" else table[n].cast(pa.float32(), safe=False) for n in table.column_names}
    options = {"compression": "zstd", "compression_level": 19, "use_dictionary": False, "use_byte_stream_split": True}
    pq.write_table(pa.table(narrow), file, **options)


if __name__ == "__main__":
    sys.exit(main())
