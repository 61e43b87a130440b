"""What the experiments write: a JSON file with its command, versions, worlds and budget."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from training import Budget

from vispeg.core.files import write_text_atomic
from vispeg.core.provenance import provenance
from vispeg.task.world_file import load_world


def write_result(
    path: Path,
    values: Mapping[str, Any],
    budget: Budget,
    seeds: Sequence[int],
    worlds: Iterable[str],
    inputs: Iterable[Path] = (),
) -> None:
    """Write `values` with what is needed to repeat them; replace what an earlier call of the same command wrote."""
    origin = provenance(["python", *sys.argv], None, inputs)
    origin["versions"] |= {name: version(name) for name in ("torch", "stable-baselines3")}
    files = [load_world(world) for world in worlds]
    head = {"budget": asdict(budget), "seeds": list(seeds), "worlds": {f.name: f.hash for f in files}}
    record = {**head, **values, "provenance": origin}
    write_text_atomic(path, json.dumps(record, indent=1, allow_nan=False) + "\n", overwrite=True)
