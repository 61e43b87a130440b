"""`vispeg.gap`: play policies in several worlds on the same seeds; find what each loses, and due to which factor."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from vispeg.api.playing import (
    Played,
    Playing,
    check_controls,
    check_numbers,
    folders,
    other_tolerances,
    play,
    silent,
    stamped,
)
from vispeg.core.cluster import Engine
from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.core.several import several, single
from vispeg.evaluation import gap as gaps
from vispeg.evaluation.entrants import EXPERT, Entrant, Policies, given, refuse_trained_on
from vispeg.evaluation.films.media import film_seeds
from vispeg.evaluation.folder import EPISODES, workplace
from vispeg.evaluation.jobs import Job, Setting, make_jobs, seeds_of
from vispeg.evaluation.measured import Trials, read_measured
from vispeg.evaluation.players import ready
from vispeg.evaluation.records import Episode, read_all
from vispeg.evaluation.runner import check_stored, made_with, names_of, take_in
from vispeg.report.gap import words
from vispeg.report.text.summary import Block, Line
from vispeg.report.text.tables import Column, Sheet
from vispeg.task.registry import config_of
from vispeg.task.world_file import WorldFile, load_world

WORLDS = ("S", "V", "N", "P", "VNP")


class GapResult(Played):
    """What each policy loses from the training world to the others, with intervals; see `Played`."""

    command = holds = "gap"
    tables = ("success",)

    @property
    def summary(self) -> list[Block]:
        """Success of each policy in each world, and each gap in words."""
        values = self.record
        cells = {(r["policy"], r["world"]): words.rate(r["success"]) for r in values["success"] if not r["control"]}
        order = [w["name"] for w in values["worlds"]]
        rows = [[p["name"], *(cells.get((p["name"], w), "-") for w in order)] for p in values["policies"]]
        out: list[Block] = [Sheet([Column(head) for head in ("policy", *order)], rows)]
        for row in (*values["gaps"], *values["measures"]):
            out.append(Line(f"{row['policy']} in {row['world']}: {row['words']}", path=True))
        out += [Line(f"{g['policy']} in {g['world']}: {g['worth']['words']}") for g in values["gaps"] if g["worth"]]
        out += [Line(f"{row['world']} over policies: {row['words']}") for row in values["prediction"]]
        return out


@dataclass(frozen=True)
class _Worlds:
    """The worlds of a gap: what the user named, their files, and which controls are played where."""

    sources: tuple[str, ...]
    files: tuple[WorldFile, ...]
    controlled: tuple[str, ...]
    controls: tuple[str, ...]

    @property
    def names(self) -> list[str]:
        return [file.name for file in self.files]

    def settings(self) -> list[Setting]:
        """Return the settings of every world without control, then those of the controls."""
        places = dict(zip(self.names, self.sources, strict=True))
        plain = [Setting(world, name) for name, world in places.items()]
        return plain + [Setting(places[name], name, control=c) for name in self.controlled for c in self.controls]


def gap(
    policies: Policies = (),
    worlds: str | Path | Sequence[str | Path] | None = None,
    *,
    episodes: int = 100,
    controls: str | Sequence[str] | None = None,
    control_worlds: str | Sequence[str] | None = None,
    records: str | Path | Sequence[str | Path] = (),
    measured: str | Path | None = None,
    robot: str = "robot",
    videos: int = 0,
    fine_tuned: bool = False,
    seed: int = 0,
    workers: int = 1,
    engine: Engine = "local",
    out: str | Path | None = None,
    overwrite: bool = False,
    playing: Playing = silent,
) -> GapResult:
    """Play policies in several worlds on the same seeds; return the loss of each with 95 % intervals.

    The loss in a world named after others (VNP after V, N, P) is split into their shares. A world that a policy was
    trained in is marked as its home. Videos need `out`.

    Args:
        policies: folders, NAME=FOLDER, MODULE:CLASS, lerobot:FOLDER, .onnx or .zip files. Policies of one name are
            replicas with different training seeds.
        worlds: names of built-in worlds or world files; the first is the reference. Default: S, V, N, P and
            VNP; with records and no policies the worlds of the records, these first.
        episodes: number of episodes of every policy in every world, and for each control in each of `control_worlds`.
        controls: shuffled, frozen, and GOAL_fixed with the cell's name of the goal; `none` for no controls; default:
            all.
        control_worlds: worlds of the controls; default: the first and the last of `worlds`.
        records: files of episodes to reuse.
        measured: a real robot's trials: a CSV, or a folder of trials by `vispeg run`.
        robot: name of the measured target in tables.
        videos: number of episodes of each policy to film in the first and the last world, new failures first.
        fine_tuned: allow policies that were trained or fine-tuned with a part of a target.
        seed, workers, engine, out, overwrite, playing: as in `vispeg.evaluate`.

    Raises:
        UserError: nothing to evaluate; an unknown or unfit policy, world, control or record; a policy that was trained
            with a part of a target.
    """
    named = given(policies)
    files = [Path(r) for r in several(records)]
    measured = None if measured is None else single(measured, "--measured")
    control_worlds = None if control_worlds is None else several(control_worlds)
    if not named and not files:
        raise UserError("nothing to evaluate", expected="policy folders, or --records FILE")
    who, stored_before = ready(policies) if named else [], read_all(files) if files else []
    worlds = several(worlds) if worlds is not None else WORLDS if who else _recorded(stored_before)
    stored_names = names_of(*files)
    networks = [*((e.name, e.train_seed) for e in who), *((e.policy, e.train_seed) for e in stored_before)]
    digests = {e.exported: (e.name, e.train_seed) for e in who if e.exported}
    digests |= {e.digest: (e.name, e.train_seed) for e in who}
    read: list[str | Path | None] = [*files, measured, *folders(who)]
    chosen = None
    if who:
        check_numbers(episodes, workers)
        chosen = _worlds(worlds, controls, control_worlds, who, fine_tuned)
        read += [file.path for file in chosen.files]
        if stored_before:  # check the records before OUT is touched, as it may hold them
            with TemporaryDirectory() as folder:
                seeds = seeds_of(episodes, seed)
                check_stored(make_jobs(who, chosen.settings(), seeds, Path(folder)), stored_before, files)
    tasks = {config_of(file.task).name for file in chosen.files} if chosen is not None else set()
    trials = _measured(measured, networks, robot, digests, tasks)
    names = [str(w) for w in worlds] if chosen is None else chosen.names
    if trials.episodes and robot in {*names, *(e.world for e in stored_before)}:
        raise UserError("a world has the robot's name", key="--robot", expected="another name", got=robot)
    tolerance_notes = other_tolerances(who, () if chosen is None else chosen.files)
    for text in tolerance_notes:
        note(text)
    with workplace(out if who else None, "gap.json", overwrite, read) as place:
        jobs: list[Job] = []
        played = []
        if chosen is not None:
            if stored_before:
                take_in(stored_before, stored_names, place)
            jobs = make_jobs(who, chosen.settings(), seeds_of(episodes, seed), place / "worlds")
            played = play(jobs, place, workers, playing, engine)
        ends = {e.key: e for e in [*stored_before, *played]}
        every = [*ends.values(), *trials.episodes]
        targets = [*names, *([robot] if trials.episodes else [])]
        # policy's name -> digest; in `made_with` a name ends in /sSEED
        known = {name.rpartition("/")[0]: digest for file in files for name, digest in made_with(file).items()}
        known |= {e.name: e.digest for e in who}
        # the scripted expert, and its usual name unless that is another policy's
        scripted = {name for name, digest in known.items() if digest == EXPERT} | ({EXPERT} - set(known))
        homes = {e.name: {h for r in who if r.name == e.name for h in r.trained_on} for e in who if e.trained_on}
        values = gaps.gap(every, names[0], targets, seed, [*tolerance_notes, *trials.notes], scripted, homes)
        filmed = out is not None and videos > 0 and bool(jobs)
        filmed_in = list(dict.fromkeys((names[0], names[-1])))
        media = film_seeds(jobs, list(ends.values()), filmed_in, place / "media", videos) if filmed else []
        inputs = [*files, *([Path(measured)] if measured else [])]
        sources = tuple(p for p in read if p is not None)
        stored_names = names_of(place / EPISODES) if who else stored_names
        result = GapResult(stamped(values, seed, inputs), tuple(every), tuple(media), sources, stored_names)
        if out is not None and who:
            result._write(place)
    if out is not None and not who:
        result.save(out, overwrite=overwrite)
    return result


def _recorded(episodes: Sequence[Episode]) -> list[str]:
    """Return the names of the worlds of episodes, those of `WORLDS` first and in that order."""
    found = dict.fromkeys(e.world for e in episodes)
    return list(dict.fromkeys(w for w in (*WORLDS, *found) if w in found))


def _worlds(
    sources: Sequence[str | Path],
    controls: str | Sequence[str] | None,
    control_worlds: Sequence[str] | None,
    who: Sequence[Entrant],
    fine_tuned: bool,
) -> _Worlds:
    """Read the worlds, and check the controls.

    Raises:
        UserError: no world; two of one name; an unknown control world; or, unless `fine_tuned`, a policy trained with a
            part of a target.
    """
    if not sources:
        raise UserError("no world given", key="--worlds", expected="at least one")
    files = [load_world(w) for w in sources]
    names = [f.name for f in files]
    if len(set(names)) < len(names):
        raise UserError("two worlds of one name", key="--worlds", got=", ".join(names))
    name_of = dict(zip(map(str, sources), names, strict=True))
    chosen = (names[0], names[-1]) if control_worlds is None else control_worlds
    controlled = dict.fromkeys(name_of.get(w, w) for w in chosen)
    for name in controlled:
        if name not in names:
            raise UserError("not one of --worlds", key="--control-worlds", got=name, choices=names)
    for file in files[1:]:
        if not fine_tuned:
            # the other policies were trained in this world, which is allowed and marked
            others = [e for e in who if file.hash not in e.trained_on]
            refuse_trained_on(others, file.name, file.hash, file.path, training=files[0].path)
    return _Worlds(tuple(map(str, sources)), tuple(files), tuple(controlled), check_controls(controls, files[0]))


def _measured(
    source: str | Path | None,
    networks: Sequence[tuple[str, int]],
    robot: str,
    digests: Mapping[str, tuple[str, int]],
    tasks: Collection[str],
) -> Trials:
    """Read a real robot's trials of these policies (name, training seed) and tasks; empty without a source."""
    seeds: dict[str, set[int]] = {}
    for name, seed in networks:
        seeds.setdefault(name, set()).add(seed)
    return Trials() if source is None else read_measured(Path(source), robot, seeds, digests, tasks)
