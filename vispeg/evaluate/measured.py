"""Success records of a real robot, as a CSV that a person can type."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.evaluate.records import CATEGORIES, Episode

REQUIRED = ("policy", "seed", "outcome")
OPTIONAL = ("configuration", "category", "modality", "train_seed", "time", "peak_force")
OUTCOMES = {"success": True, "1": True, "true": True, "yes": True, "failure": False, "0": False, "false": False}
OUTCOMES |= {"fail": False, "no": False}


def read_csv(path: str | Path, world: str = "robot", policies: Iterable[str] = ()) -> list[Episode]:
    """Reads columns policy, seed, outcome and, where there are, configuration, category, modality, train_seed, time,
    peak_force.

    Args:
        path: the CSV, first row its heads, one row a trial. `outcome` is success or failure (also 1/0, true/false,
            yes/no); `seed` is the trial's number, or the simulated episode's seed where the same start and hole were
            set up.
        world: the name under which these records stand in tables.
        policies: the names that are known; empty: any.

    Raises:
        UserError: a file that cannot be read, a missing or unknown column, an unknown policy or outcome, a seed that is
            not a whole number, an outcome that contradicts its category, a trial that stands twice.
    """
    path, known = Path(path), set(policies)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            heads = [h.strip() for h in reader.fieldnames or ()]
            reader.fieldnames = heads
            rows = [(reader.line_num, row) for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UserError("cannot be read", file=path, got=str(error)) from error
    for column in REQUIRED:
        if column not in heads:
            raise UserError("a column is missing", file=path, expected=column, got=", ".join(heads))
    for column in heads:
        if column not in REQUIRED + OPTIONAL:
            raise UserError("unknown column", file=path, got=column, choices=REQUIRED + OPTIONAL)
    episodes: dict[tuple[object, ...], Episode] = {}
    for number, row in rows:
        episode = _episode(row, world, known, path, number)
        if episode.key in episodes:
            raise UserError("the same trial twice", file=path, key=f"line {number}", got=episode.key)
        episodes[episode.key] = episode
    if not episodes:
        raise UserError("no trials", file=path, expected="a row a trial below the heads")
    return list(episodes.values())


def _episode(row: dict[str, str | None], world: str, known: set[str], path: Path, number: int) -> Episode:
    where = {"file": path, "key": f"line {number}"}
    if None in row or any(v is None for v in row.values()):
        raise UserError("another number of cells than heads", **where)
    cell = {k: (v or "").strip() for k, v in row.items()}
    policy, outcome = cell["policy"], cell["outcome"].lower()
    if not policy or (known and policy not in known):
        raise UserError("unknown policy", **where, got=policy, choices=sorted(known))
    if outcome not in OUTCOMES:
        raise UserError("unknown outcome", **where, got=cell["outcome"], choices=OUTCOMES)
    success = OUTCOMES[outcome]
    category = cell.get("category") or ("success" if success else "failure")
    if (category == "success") != success:
        raise UserError("outcome and category contradict each other", **where, got=f"{outcome}, {category}")
    if category not in (*CATEGORIES, "failure"):
        raise UserError("unknown category", **where, got=category, choices=(*CATEGORIES, "failure"))
    whole = {k: _number(cell.get(k) or "0", int, k, where) for k in ("seed", "train_seed")}
    real = {k: _number(cell.get(k) or "nan", float, k, where) for k in ("time", "peak_force")}
    return Episode(
        policy=policy,
        modality=cell.get("modality", ""),
        train_seed=int(whole["train_seed"]),
        world=world,
        world_hash="",
        seed=int(whole["seed"]),
        success=success,
        category=category,
        time=real["time"],
        peak_force=real["peak_force"],
        configuration=cell.get("configuration", ""),
    )


def _number(text: str, kind: type[int] | type[float], name: str, where: dict[str, object]) -> float:
    try:
        return kind(text)
    except ValueError:
        raise UserError(f"{name} is not a number", file=str(where["file"]), key=str(where["key"]), got=text) from None
