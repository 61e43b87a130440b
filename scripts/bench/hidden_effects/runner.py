"""Runs `vispeg diagnose` on every case in a process of its own, a few at a time; a killed run resumes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
from dataclasses import asdict
from functools import cache, partial
from pathlib import Path

from cases import Case
from everywhere import Engine, each
from make import folders

HERE = Path(__file__).resolve().parent
TIMEOUT = 1800.0  # s a process
KNOWN = ("single", "pair", "many")  # kinds of cases that hide effects of the library alone
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def _call(arguments: list[str]) -> tuple[int, str, float]:
    """Run Python; return exit status, stdout or (where it failed) stderr, and processor seconds."""
    environment = os.environ | ONE_THREAD | {"PYTHONPATH": str(HERE.parents[2])}
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        child = subprocess.Popen([sys.executable, *arguments], stdout=out, stderr=err, env=environment)
        guard = threading.Timer(TIMEOUT, child.kill)
        guard.start()
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        seconds = used.ru_utime + used.ru_stime
        if not guard.is_alive():
            return 124, f"no answer within {TIMEOUT:.0f} s", seconds
        guard.cancel()
        text = out if child.returncode == 0 else err
        text.seek(0)
        return child.returncode, text.read(), seconds


def diagnose(root: Path, case: Case) -> dict:
    """Return the record of one case, which `score.report` reads."""
    first, second, last = folders(root, case)
    out = root / "diagnosis" / case.key
    status, text, seconds = _call([
        "-m", "vispeg", "diagnose", "iiwa14", "--recording", str(first), "--recording", str(second),
        "--validate", str(last), "--out", str(out), "--overwrite", "--quiet", "--threads", "1",
    ])  # fmt: skip
    record: dict = {"case": case.name, "kind": case.kind, "mode": case.mode, "hidden": [asdict(h) for h in case.hidden]}
    record |= {"seed": case.seed, "seconds": round(seconds, 1), "commit": commit()}
    if status != 0:
        return record | {"verdict": "failed", "effects": [], "message": text[-2000:]}
    found = json.loads((out / "diagnosis.json").read_text())
    record |= {key: found[key] for key in ("verdict", "effects", "ladder", "unexplained")}
    return record | {"floor": found["noise_floor"]["value"]}


@cache
def commit() -> str | None:
    """Return the short hash of the checkout's commit, `-dirty` if it was changed since; None outside of a checkout."""
    command = ["git", "-C", str(HERE), "describe", "--always", "--dirty", "--exclude=*"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None


def references(root: Path, case: Case, baseline: bool = False) -> dict:
    """Return the errors of a fit of the true effects, and on request of a fixed parameter set, in a case."""
    extra = ["--baseline"] if baseline and case.kind == "single" else []
    folder, hidden = folders(root, case)[0].parent, json.dumps([asdict(h) for h in case.hidden])
    status, text, _ = _call([str(HERE / "reference.py"), str(folder), hidden, *extra])
    return json.loads(text.splitlines()[-1]) if status == 0 else {"reference_failed": text[-500:]}


def refer(root: Path, chosen: list[Case], results: Path, workers: int, engine: Engine = "local") -> str:
    """Return held-out errors of fits that know the truth, over the noise floor, as a Markdown table.

    Nothing is diagnosed; cases that hide an unknown effect are left out. Each is appended to `results` as it comes;
    what is there is kept.
    """
    known = _read(results, {c.seed for c in chosen})
    fitted = [c for c in chosen if c.kind in KNOWN]
    results.parent.mkdir(parents=True, exist_ok=True)
    for case, answer in each(partial(references, root), [c for c in fitted if c.name not in known], workers, engine):
        known[case.name] = {"case": case.name, "seed": case.seed} | answer
        with results.open("a") as file:
            file.write(json.dumps(known[case.name]) + "\n")
        print(f"{sum(c.name not in known for c in fitted):4d} left  {case.name}", file=sys.stderr, flush=True)
    lines = ["| case | truth, error / floor |", "| --- | --- |"]
    for case in fitted:
        truth = known[case.name].get("oracle")
        lines.append(
            f"| {case.name} | {truth['heldout_error'] / truth['floor']:.3g} |" if truth else f"| {case.name} | failed |"
        )
    return "\n".join(lines) + "\n"


def _read(results: Path, seeds: set[int]) -> dict[str, dict]:
    """Return the records of these seeds in a file of results, by case; a line cut short by a kill is run again."""
    known: dict[str, dict] = {}
    for line in results.read_text().splitlines() if results.exists() else []:
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            continue
        if record.get("seed") in {None, *seeds}:
            known[record["case"]] = record
    return known


def _lacks(case: Case, record: dict | None, reference: bool, baseline: bool) -> bool:
    if record is None:
        return True
    if record["verdict"] == "failed" or "reference_failed" in record:
        return False
    asked = reference and case.kind in KNOWN and "oracle" not in record
    return asked or (reference and baseline and case.kind == "single" and "baseline" not in record)


def run(
    root: Path,
    chosen: list[Case],
    results: Path,
    workers: int,
    reference: bool,
    baseline: bool,
    engine: Engine = "local",
) -> list[dict]:
    """Return the records of the chosen cases; each is appended to `results` as it comes, what is there is kept."""
    known = _read(results, {c.seed for c in chosen})
    # in the order of their hashes, so that a run cut short is still an even sample of the list
    missing = sorted((c for c in chosen if _lacks(c, known.get(c.name), reference, baseline)), key=lambda c: c.key)
    results.parent.mkdir(parents=True, exist_ok=True)
    work = partial(_whole, root, {c.name: known[c.name] for c in missing if c.name in known}, reference, baseline)
    for left, (case, record) in enumerate(each(work, missing, workers, engine), 1 - len(missing)):
        known[case.name] = record
        with results.open("a") as file:
            file.write(json.dumps(record) + "\n")
        named = ", ".join(f"{e['effect']}({e['where']})" for e in record["effects"]) or "-"
        print(f"{-left:4d} left  {case.name}: {record['verdict']}: {named}", file=sys.stderr, flush=True)
    return [known[c.name] for c in chosen if c.name in known]


def _whole(root: Path, known: dict[str, dict], reference: bool, baseline: bool, case: Case) -> dict:
    """Return the record of a case, completed by the references that it lacks."""
    record = known.get(case.name) or diagnose(root, case)
    return record | references(root, case, baseline) if _lacks(case, record, reference, baseline) else record
