"""Read success records of a real robot: a CSV that a person can type, or the trials that `vispeg run` kept."""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.core.seeds import check_seed
from vispeg.evaluation.records import Episode, measure
from vispeg.formats.format import enrol
from vispeg.formats.guard import MB, read_text
from vispeg.task.registry import FIRST, task
from vispeg.trials.trial import FILE, folders, read_said

_Found = tuple[Episode, bool, Path, str]  # an episode, whether its seed is stated, its file and key
LARGEST = 64 * MB
REQUIRED = ("policy", "seed", "outcome")
OPTIONAL = ("configuration", "category", "modality", "train_seed", "time", "peak_force")
OUTCOMES = {"success": True, "1": True, "true": True, "yes": True, "failure": False, "0": False, "false": False}
OUTCOMES |= {"fail": False, "no": False}


@dataclass(frozen=True)
class Trials:
    """A real robot's trials.

    Attributes:
        episodes: one per trial.
        notes: what was assumed about them, to be stated with the result.
    """

    episodes: list[Episode] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def _example(folder: Path) -> Path:
    path = folder / "robot.csv"
    path.write_text("policy,seed,outcome,category,time,peak_force\na,1,success,,2.5,8\na,2,failure,jam,,\n")
    return path


@enrol("success records (CSV)", _example)
def read_csv(
    path: str | Path,
    world: str = "robot",
    policies: Mapping[str, Collection[int]] | None = None,
    configurations: Collection[str] = (),
) -> Trials:
    """Read a CSV of trials, one row per trial.

    Its columns are policy, seed and outcome, and optionally configuration, category, modality, train_seed, time (s) and
    peak_force (N).

    Args:
        path: the CSV; its first row names the columns. `outcome` is success or failure (also 1/0, true/false, yes/no).
            `seed` is the trial's number, or the simulated episode's seed where the same start and goal were set up;
            rows with an empty one are different trials. A failure's `category` is one of the task's categories or a
            word of the user's own.
        world: the name of the robot's world in tables.
        policies: known names with their training seeds; none to accept any name. A row without a training seed gets
            the policy's lowest one; if there are several, a note says so.
        configurations: known names; empty to accept any.

    Raises:
        UserError: the file cannot be read; a column is missing, unknown or repeated; a policy, configuration or outcome
            is unknown; a seed is not a whole number; an outcome contradicts its category; a trial is there twice; or
            there is no trial.
    """
    path, seeds_of = Path(path), {name: sorted(seeds) for name, seeds in (policies or {}).items()}
    try:
        reader = csv.DictReader(io.StringIO(read_text(path, LARGEST), newline=""))
        heads = [h.strip() for h in reader.fieldnames or ()]
        reader.fieldnames = heads
        # a spreadsheet writes an empty row as commas alone
        rows = [
            (reader.line_num, row) for row in reader if None in row or any(map(str.strip, filter(None, row.values())))
        ]
    except csv.Error as error:
        raise UserError("is not CSV", file=path, got=str(error)) from error
    if twice := [head for i, head in enumerate(heads) if head in heads[:i]]:
        raise UserError("two columns of one name", file=path, got=twice[0])
    for column in REQUIRED:
        if column not in heads:
            raise UserError("a column is missing", file=path, expected=column, got=", ".join(heads))
    for column in heads:
        if column not in REQUIRED + OPTIONAL:
            raise UserError("unknown column", file=path, got=column, choices=REQUIRED + OPTIONAL)
    found: list[_Found] = []
    assumed: dict[str, None] = {}  # policies whose training seed is assumed; a dict keeps their order
    for number, row in rows:
        episode = _episode(row, world, seeds_of, path, number)
        found.append((episode, bool(_cell(row, "seed")), path, f"line {number}"))
        if not _cell(row, "train_seed") and len(seeds_of.get(episode.policy, ())) > 1:
            assumed[episode.policy] = None
    if not found:
        raise UserError("no trials", file=path, expected="one row per trial below the head")
    episodes = _numbered(found)
    unknown = sorted({e.configuration for e in episodes} - set(configurations))
    if configurations and unknown:
        named = ", ".join(map(repr, unknown))
        raise UserError(f"the suite does not know the configurations {named}", file=path, choices=configurations)
    notes = [_note(path, name, seeds_of[name]) for name in assumed]
    return Trials(episodes, notes)


def read_measured(
    path: str | Path,
    world: str = "robot",
    policies: Mapping[str, Collection[int]] | None = None,
    digests: Mapping[str, tuple[str, int]] | None = None,
) -> Trials:
    """Read a CSV (`read_csv`), or a folder of trials (`vispeg.trials.trial`).

    Trials in which the policy did not move the arm, or not at full speed, are left out; a note counts them. Another
    tells of trials of another policy of the same name. Trials without a seed are different ones.

    Args:
        path: the CSV or the folder.
        world, policies: as in `read_csv`.
        digests: digest of each known policy -> its name and training seed; a trial with one of these digests gets them.

    Raises:
        UserError: as `read_csv`; a folder without trials at full speed, an invalid trial, an unknown policy, or
            the same trial twice.
    """
    if not Path(path).is_dir():
        return read_csv(path, world, policies)
    found: list[_Found] = []
    left_out, others, known = 0, dict[str, None](), digests or {}
    names = {name for name, _ in known.values()}
    for folder in folders(path):
        said, file = read_said(folder), folder / FILE
        if not said.full_speed:
            left_out += 1
            continue
        name, seed = known.get(said.policy.digest, (said.policy.name, said.policy.train_seed))
        if policies and name not in policies:
            raise UserError("unknown policy", file=file, key="policy.name", got=name, choices=sorted(policies))
        if said.policy.digest and said.policy.digest not in known and name in names:
            others[name] = None
        o = said.outcome
        episode = Episode(
            policy=name,
            modality=said.policy.modality,
            train_seed=seed,
            world=world,
            world_hash="",
            seed=said.seed or 0,
            success=o.success,
            category=o.category,
            time=o.time_s,
            peak_force=math.nan if o.peak_force_n is None else o.peak_force_n,
            depth=math.nan if o.depth_m is None else o.depth_m,
        )
        found.append((episode, said.seed is not None, file, "seed"))
    if not found:
        raise UserError("no trials in which the arm was moved at full speed", file=path)
    place = Path(path).name
    notes = [f"{count(left_out, 'trial')} of {place} left out: shadows or slowed down"] if left_out else []
    notes += [f"{place} holds trials of another policy than the {name} that is given" for name in others]
    return Trials(_numbered(found), notes)


def _numbered(found: Sequence[_Found]) -> list[Episode]:
    """Return the episodes, with the first free numbers as seeds of those without one.

    Raises:
        UserError: two with a seed are the same trial.
    """
    taken = {episode.seed for episode, stated, *_ in found if stated}
    free = (number for number in itertools.count() if number not in taken)
    episodes: dict[tuple[object, ...], Episode] = {}
    for trial, stated, file, key in found:
        episode = trial if stated else replace(trial, seed=next(free))
        if episode.key in episodes:
            raise UserError("the same trial twice", file=file, key=key, got=episode.key)
        episodes[episode.key] = episode
    return list(episodes.values())


def _note(path: Path, policy: str, seeds: list[int]) -> str:
    listed = ", ".join(map(str, seeds))
    return f"{path.name} does not tell which training seed of {policy} ({listed}) was tried; {seeds[0]} is assumed"


def _cell(row: Mapping[str, str | None], name: str) -> str:
    return (row.get(name) or "").strip()


def _episode(
    row: dict[str, str | None], world: str, seeds_of: Mapping[str, list[int]], path: Path, number: int
) -> Episode:
    where = {"file": path, "key": f"line {number}"}
    if None in row or any(v is None for v in row.values()):
        raise UserError("the row has another number of cells than there are columns", **where)
    cell = {k: _cell(row, k) for k in row}
    policy, outcome = cell["policy"], cell["outcome"].lower()
    if not policy or (seeds_of and policy not in seeds_of):
        raise UserError("unknown policy", **where, got=policy, choices=sorted(seeds_of))
    if outcome not in OUTCOMES:
        raise UserError("unknown outcome", **where, got=cell["outcome"], choices=OUTCOMES)
    success = OUTCOMES[outcome]
    category = cell.get("category") or ("success" if success else "failure")
    if category.lower() in task(FIRST).categories:  # a user's own word keeps its case
        category = category.lower()
    if (category == "success") != success:
        raise UserError("outcome and category contradict each other", **where, got=f"{outcome}, {category}")
    default = str(seeds_of[policy][0]) if seeds_of.get(policy) else "0"
    integers = {k: _whole(cell.get(k) or d, k, where) for k, d in (("seed", "0"), ("train_seed", default))}
    real = {k: _real(cell.get(k) or "", k, where) for k in ("time", "peak_force")}
    return Episode(
        policy=policy,
        modality=cell.get("modality", ""),
        train_seed=integers["train_seed"],
        world=world,
        world_hash="",
        seed=integers["seed"],
        success=success,
        category=category,
        time=real["time"],
        peak_force=real["peak_force"],
        configuration=cell.get("configuration", ""),
    )


def _whole(text: str, name: str, where: Mapping[str, Any]) -> int:
    try:
        value = int(text)
    except ValueError:  # not a number, or one with thousands of digits
        value = None
    check_seed(text if value is None else value, f"{where['key']}: {name}", where["file"])
    return int(text)


def _real(text: str, name: str, where: Mapping[str, Any]) -> float:
    """Return the number in a cell; NaN if the cell is empty."""
    if text.lower() in ("", "nan"):
        return math.nan
    try:
        value: Any = float(text)
    except ValueError:
        value = text
    return measure(name, value, where)
