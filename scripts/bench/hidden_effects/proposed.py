"""Scores the linear proposal in torque space alone: the effects that it calls likely, before any rollout."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from cases import Case
from make import folders
from runner import commit
from score import Record, _matched, _median, _row, same_class, share

from vispeg.api.inputs import read_inputs
from vispeg.core.effect import REGISTRY
from vispeg.diagnosis.proposal import propose
from vispeg.identify.channels import shows


def straight(name: str) -> bool:
    """Return whether an effect's torque on a measured motion is linear in its size, so that a proposal can have it."""
    return shows(REGISTRY[name], "needed") or REGISTRY[name].overrides("regressor")


def proposed(root: Path, case: Case) -> Record:
    """Return the likely effects of one case, the share of the missing torque that they explain, and CPU seconds."""
    first, second, last = folders(root, case)
    inputs = read_inputs("iiwa14", [first, second], [last])
    begin = time.process_time()
    found = propose(inputs.world, inputs.fitted, inputs.held_out)
    seconds = time.process_time() - begin
    record: Record = {"case": case.name, "kind": case.kind, "mode": case.mode, "seed": case.seed, "commit": commit()}
    record["hidden"] = [{"effect": h.effect, "where": h.where, "params": h.params} for h in case.hidden]
    said = found.record if found is not None else {"effects": [], "before": None, "after": None}
    effects = [{**e, "indistinguishable_from": e["equals"]} for e in said["effects"]]
    return record | {"effects": effects, "before": said["before"], "after": said["after"], "seconds": round(seconds, 2)}


def run(root: Path, chosen: Sequence[Case], results: Path) -> list[Record]:
    """Return the records of the chosen cases; each is appended to `results` as it comes, what is there is kept."""
    known = {r["case"]: r for r in map(json.loads, results.read_text().splitlines())} if results.exists() else {}
    results.parent.mkdir(parents=True, exist_ok=True)
    for case in chosen:
        if case.name not in known:
            known[case.name] = proposed(root, case)
            with results.open("a") as file:
                file.write(json.dumps(known[case.name]) + "\n")
            print(case.name, *(f"{e['effect']}({e['where']})" for e in known[case.name]["effects"]), file=sys.stderr)
    return [known[c.name] for c in chosen]


def table(records: Sequence[Record]) -> str:
    """Return the score as Markdown: a row a kind of case; a hidden effect counts as proposed by class and place."""
    lines = [_row("cases", "of", "hidden effects that are likely", "beside them, a case", "cases with none beside them",
                  "torque left, held out", "processor s, median and greatest"), _row(*["---"] * 7)]  # fmt: skip
    groups = {
        "one straight effect": lambda r: r["kind"] == "single" and straight(r["hidden"][0]["effect"]),
        "one that is bent or acts in the loop alone": lambda r: (
            r["kind"] == "single" and not straight(r["hidden"][0]["effect"])
        ),
        "pairs": lambda r: r["kind"] == "pair",
        "6 to 20 effects": lambda r: r["kind"] == "many",
        "the same and an unknown one": lambda r: r["kind"] == "strange",
        "an unknown one": lambda r: r["kind"] == "unknown",
        "none": lambda r: r["kind"] == "none",
    }
    for name, belongs in groups.items():
        group = [r for r in records if belongs(r)]
        if group:
            lines.append(_row(name, len(group), *_cells(group)))
    return "\n".join(lines) + "\n"


def _cells(group: Sequence[Record]) -> list[str]:
    """Return the shares and medians of one group."""
    hits, beside = [], []
    for r in group:
        truth = [h for h in r["hidden"] if h["effect"] in REGISTRY]
        n = _matched(truth, r["effects"])
        hits += [k < n for k in range(len(truth))]
        beside.append(sum(not any(same_class(t, e) for t in truth) for e in r["effects"]))
    left = [r["after"] / r["before"] for r in group if r["before"]]
    seconds = [r["seconds"] for r in group]
    return [
        share(hits),
        f"{sum(beside) / len(group):.2f}",
        share(not n for n in beside),
        f"{100 * sorted(left)[len(left) // 2]:.0f} %" if left else "-",
        f"{_median(seconds)}, {max(seconds):.3g}",
    ]
