"""Runs `vispeg diagnose`, or a fit of the truth, on every case in a process of its own; a killed run resumes."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from contact_cases import Case
from contact_make import folders
from everywhere import Engine, each
from runner import commit

HERE = Path(__file__).resolve().parent
TIMEOUT = 1200.0  # s a process
KEYS = ("verdict", "effects", "ladder", "noise_floor", "unexplained", "not_excited", "shows_from", "phases")


def diagnose(root: Path, case: Case) -> dict:
    """Return the record of one case, which `contact_score.report` reads."""
    *fit, judge = folders(root, case).values()
    out = root / "diagnosis" / case.key
    command = [sys.executable, "-m", "vispeg", "diagnose", "peg-cell"]
    for folder in fit:
        command += ["--recording", str(folder)]
    command += ["--validate", str(judge), "--out", str(out), "--overwrite", "--quiet", "--threads", "1"]
    record, answer = _called(case, command)
    if answer is None:
        return record
    found = json.loads((out / "diagnosis.json").read_text())
    return record | {key: found.get(key) for key in KEYS}


def reference(root: Path, case: Case) -> dict:
    """Return the errors of a fit of the true effects in one case, which `contact_score.references` reads."""
    *fit, judge = folders(root, case).values()
    command = [sys.executable, str(HERE / "contact_reference.py"), str(judge), json.dumps(case.hidden), *map(str, fit)]
    record, answer = _called(case, command)
    return record if answer is None else record | {"verdict": "fitted", "effects": case.hidden} | json.loads(answer)


def _called(case: Case, command: list[str]) -> tuple[dict, str | None]:
    """Run a process for a case; return its record and its output, None if it failed, which the record then states."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(HERE.parents[2])}
    record: dict = {"case": case.name, "kind": case.kind, "hidden": case.hidden, "seed": case.seed, "commit": commit()}
    begin, before = time.monotonic(), _cpu()
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT, env=environment, check=False)
        status, text = done.returncode, done.stderr
    except subprocess.TimeoutExpired:
        status, text = 124, f"no answer within {TIMEOUT:.0f} s"
    record |= {"seconds": round(time.monotonic() - begin, 1), "cpu_s": round(_cpu() - before, 1)}
    if status != 0:
        return record | {"verdict": "failed", "effects": [], "message": text[-2000:]}, None
    return record, done.stdout


def _cpu() -> float:
    """Return the processor seconds of the children that ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def finished(results: Path, seed: int) -> dict[str, dict]:
    """Return the records of a seed in a file of results, by the name of their case; a line cut short by a kill is no
    record.

    Records without a seed, which are older, are returned too.
    """
    records: dict[str, dict] = {}
    if results.exists():
        for line in results.read_text().splitlines():
            try:
                record = json.loads(line)
            except json.JSONDecodeError:
                continue
            if record["verdict"] != "failed" and record.get("seed", seed) == seed:
                records[record["case"]] = record
    return records


def run(
    root: Path,
    chosen: list[Case],
    results: Path,
    work: Callable[[Path, Case], dict] = diagnose,
    workers: int = 1,
    engine: Engine = "local",
) -> list[dict]:
    """Return the records that `work` makes of the chosen cases, each appended to `results` as it comes.

    Cases that `results` holds already are not run again.
    """
    records = finished(results, chosen[0].seed) if chosen else {}
    # in the order of their hashes, so that a run cut short is still an even sample of the list
    missing = sorted((c for c in chosen if c.name not in records), key=lambda c: c.key)
    results.parent.mkdir(parents=True, exist_ok=True)
    several = workers if engine == "ray" else 1  # processor time is that of a process' children
    for left, (case, record) in enumerate(each(partial(work, root), missing, several, engine), 1 - len(missing)):
        records[case.name] = record
        with results.open("a") as file:
            file.write(json.dumps(record) + "\n")
        named = ", ".join(f"{e['effect']}({e['where']})" for e in record["effects"]) or "-"
        text = f"{-left:4d} left  {case.name}: {record['verdict']}: {named}  {record['cpu_s']:.0f} s"
        print(text, file=sys.stderr, flush=True)
    return [records[c.name] for c in chosen if c.name in records]
