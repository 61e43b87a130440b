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

LARGEST = 64 * MB
REQUIRED = ("policy", "seed", "outcome")
OPTIONAL = ("configuration", "category", "modality", "train_seed", "time", "peak_force")
OUTCOMES = {"success": True, "1": True, "true": True, "yes": True, "failure": False, "0": False, "false": False}
OUTCOMES |= {"fail": False, "no": False}


@dataclass(frozen=True)
class _Trial:
    """One trial as it was read.

    Attributes:
        episode: the trial; its seed is 0 if none is stated.
        numbered: whether its seed is stated.
        file, key: where an error says that its seed is, such as a CSV and `line 2`.
    """

    episode: Episode
    numbered: bool
    file: Path
    key: str


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
        path: the CSV; its first row names the columns. `outcome` is success or failure (also fail, 1/0, true/false,
            yes/no). `seed` is the trial's number, or the simulated episode's seed where the same start and goal were
            set up; rows with an empty one are different trials. A failure's `category` is one of the task's categories,
            in small or capital letters, or a word of the user's own.
        world: the name of the robot's world in tables.
        policies: known names with their training seeds; none to accept any name. A row without a training seed gets
            the policy's lowest one; if there are several, a note says so.
        configurations: known names; empty to accept any.

    Raises:
        UserError: the file cannot be read; a column is missing, unknown or repeated; a policy, training seed,
            configuration or outcome is unknown; a seed is not a whole number; an outcome contradicts its category; a
            trial is there twice; or there is no trial.
    """
    path, networks = Path(path), _Networks(policies)
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
    found = [
        _Trial(_episode(row, world, networks, path, n), bool(_cell(row, "seed")), path, f"line {n}") for n, row in rows
    ]
    if not found:
        raise UserError("no trials", file=path, expected="one row per trial below the head")
    episodes = _numbered(found)
    unknown = sorted({e.configuration for e in episodes} - set(configurations))
    if configurations and unknown:
        named = ", ".join(map(repr, unknown))
        raise UserError(f"the suite does not know the configurations {named}", file=path, choices=configurations)
    return Trials(episodes, networks.notes(path))


def read_measured(
    path: str | Path,
    world: str = "robot",
    policies: Mapping[str, Collection[int]] | None = None,
    digests: Mapping[str, tuple[str, int]] | None = None,
    tasks: Collection[str] = (),
) -> Trials:
    """Read a CSV (`read_csv`), or a folder of trials (`vispeg.trials.trial`).

    Trials in which the policy did not move the arm, or not at full speed, are left out; a note counts them. A trial
    whose policy has a known one's name but another digest counts as that policy's; a note says so. Trials without a
    seed are different ones.

    Args:
        path: the CSV or the folder.
        world, policies: as in `read_csv`.
        digests: digest of each known policy -> its name and training seed; a trial with one of these digests gets them.
        tasks: names of the judged tasks; a note names others that a trial states. Empty: any.

    Raises:
        UserError: as `read_csv`; a folder without trials at full speed, an invalid trial, an unknown policy or training
            seed, or the same trial twice.
    """
    if not Path(path).is_dir():
        return read_csv(path, world, policies)
    found: list[_Trial] = []
    left_out, known, networks = 0, digests or {}, _Networks(policies)
    others, strange = dict[str, None](), dict[str, None]()  # policies and tasks that are not the known ones, in order
    names = {name for name, _ in known.values()}
    for folder in folders(path):
        said, file = read_said(folder), folder / FILE
        if not said.full_speed:
            left_out += 1
            continue
        if tasks and said.task and said.task not in tasks:
            strange[said.task] = None
        if said.policy.digest in known:
            name, train_seed = known[said.policy.digest]
        else:
            name = said.policy.name
            networks.check(name, {"file": file, "key": "policy.name"})
            stated = said.policy.train_seed if "train_seed" in said.policy.model_fields_set else None
            train_seed = networks.train_seed(name, stated, {"file": file, "key": "policy.train_seed"})
        if said.policy.digest and said.policy.digest not in known and name in names:
            others[name] = None
        o = said.outcome
        episode = Episode(
            policy=name,
            modality=said.policy.modality,
            train_seed=train_seed,
            world=world,
            world_hash="",
            seed=0 if said.seed is None else said.seed,
            success=o.success,
            category=_category(o.category, o.success, {"file": file, "key": "outcome.category"}),
            time=o.time_s,
            peak_force=math.nan if o.peak_force_n is None else o.peak_force_n,
            depth=math.nan if o.depth_m is None else o.depth_m,
        )
        found.append(_Trial(episode, said.seed is not None, file, "seed"))
    if not found:
        raise UserError("no trials in which the arm was moved at full speed", file=path)
    place = Path(path).name
    notes = [f"{count(left_out, 'trial')} of {place} left out: shadows or slowed down"] if left_out else []
    notes += [f"{place} holds trials of another policy than the {name} that is given" for name in others]
    notes += [f"{place} holds trials of the task {t}, not of {', '.join(sorted(tasks))}" for t in strange]
    return Trials(_numbered(found), notes + networks.notes(Path(path)))


class _Networks:
    """The known policies, and what was assumed about which network of theirs was tried.

    Args:
        policies: name -> training seeds of its networks; None or empty to accept any.
    """

    def __init__(self, policies: Mapping[str, Collection[int]] | None):
        self._seeds = {name: sorted(seeds) for name, seeds in (policies or {}).items()}
        self._assumed: dict[str, None] = {}  # policies whose training seed is assumed; a dict keeps their order

    def check(self, policy: str, where: Mapping[str, Any]) -> None:
        """Raise UserError unless a policy is known; `where` is the file and the key that name it."""
        if not policy or (self._seeds and policy not in self._seeds):
            raise UserError("unknown policy", **where, got=policy, choices=sorted(self._seeds))

    def train_seed(self, policy: str, stated: int | None, where: Mapping[str, Any]) -> int:
        """Return the stated training seed, or the policy's lowest one. Raises UserError: not one of the policy's."""
        seeds = self._seeds.get(policy, ())
        if stated is None:
            if len(seeds) > 1:
                self._assumed[policy] = None
            return seeds[0] if seeds else 0
        if seeds and stated not in seeds:
            raise UserError("unknown training seed", **where, got=stated, choices=map(str, seeds))
        return stated

    def notes(self, path: Path) -> list[str]:
        """Return a sentence on each policy whose training seed was assumed."""
        return [
            f"{path.name} does not tell which training seed of {name} ({', '.join(map(str, self._seeds[name]))}) was "
            f"tried; {self._seeds[name][0]} is assumed"
            for name in self._assumed
        ]


def _numbered(trials: Sequence[_Trial]) -> list[Episode]:
    """Return the episodes, with the first free numbers as seeds of those without one.

    Raises:
        UserError: two with a seed are the same trial.
    """
    taken = {trial.episode.seed for trial in trials if trial.numbered}
    free = (number for number in itertools.count() if number not in taken)
    episodes: dict[tuple[object, ...], Episode] = {}
    for trial in trials:
        episode = trial.episode if trial.numbered else replace(trial.episode, seed=next(free))
        if episode.key in episodes:
            raise UserError("the same trial twice", file=trial.file, key=trial.key, got=episode.key)
        episodes[episode.key] = episode
    return list(episodes.values())


def _category(word: str, success: bool, where: Mapping[str, Any]) -> str:
    """Return a category in the spelling of simulated episodes, so that both are counted as one.

    Neither a CSV nor the caller says which task was tried, so these are the words of the task that a world has unless
    it names another. A user's own word keeps its case.

    Raises:
        UserError: a success of another category than `success`, or a failure of that one.
    """
    category = word.lower() if word.lower() in task(FIRST).categories else word
    if (category == "success") != success:
        got = f"{'success' if success else 'failure'}, {word}"
        raise UserError("outcome and category contradict each other", **where, got=got)
    return category


def _cell(row: Mapping[str, str | None], name: str) -> str:
    return (row.get(name) or "").strip()


def _episode(row: dict[str, str | None], world: str, networks: _Networks, path: Path, number: int) -> Episode:
    where = {"file": path, "key": f"line {number}"}
    if None in row or any(v is None for v in row.values()):
        raise UserError("the row has another number of cells than there are columns", **where)
    cell = {k: _cell(row, k) for k in row}
    policy, outcome = cell["policy"], cell["outcome"].lower()
    networks.check(policy, where)
    if outcome not in OUTCOMES:
        raise UserError("unknown outcome", **where, got=cell["outcome"], choices=OUTCOMES)
    success = OUTCOMES[outcome]
    category = _category(cell.get("category") or ("success" if success else "failure"), success, where)
    seed, train_seed = (_whole(cell.get(name) or "", name, where) for name in ("seed", "train_seed"))
    real = {k: _real(cell.get(k) or "", k, where) for k in ("time", "peak_force")}
    return Episode(
        policy=policy,
        modality=cell.get("modality", ""),
        train_seed=networks.train_seed(policy, train_seed, {**where, "key": f"{where['key']}: train_seed"}),
        world=world,
        world_hash="",
        seed=0 if seed is None else seed,
        success=success,
        category=category,
        time=real["time"],
        peak_force=real["peak_force"],
        configuration=cell.get("configuration", ""),
    )


def _whole(text: str, name: str, where: Mapping[str, Any]) -> int | None:
    """Return the seed in a cell; None if the cell is empty."""
    if not text:
        return None
    try:
        value: Any = int(text)
    except ValueError:  # not a number, or one with thousands of digits
        value = text
    check_seed(value, f"{where['key']}: {name}", where["file"])
    return value


def _real(text: str, name: str, where: Mapping[str, Any]) -> float:
    """Return the number in a cell; NaN if the cell is empty."""
    if text.lower() in ("", "nan"):
        return math.nan
    try:
        value: Any = float(text)
    except ValueError:
        value = text
    return measure(name, value, where)
