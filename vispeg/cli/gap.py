"""The transfer gap: policies in several worlds on the same seeds, what each loses, and to which factor of the change.

The first world is the one of training. A world named after others (VNP after V, N, P) is split into their shares. The
controls are played in the first world and the last; the blind one is a policy of its own, modality `proprio`. A policy
that was trained in a target is refused, unless --fine-tuned says that this is meant. A real robot's records (CSV:
policy, configuration, seed, outcome, category) take a target's place with --measured. Episodes that `vispeg evaluate`
or an earlier gap wrote are taken in with --records and not played again; given the policies too, they are filmed.
Writes OUT/gap.json, OUT/gap.html, OUT/episodes.jsonl.

Example:
    vispeg gap runs/depth_s* runs/rgb_s* --worlds S V N P VNP --episodes 500 --workers 2 --out gap
    vispeg gap --records gap/episodes.jsonl --worlds S VNP --out again
    vispeg gap runs/depth_s* runs/rgb_s* --records gap/episodes.jsonl --episodes 500 --videos 4 --out filmed
    vispeg gap depth=runs/d/best --worlds S --measured robot.csv --out real
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.core.interrupt import goes_on


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg gap`."""

    out: Path
    """Folder for the results."""
    policies: tyro.conf.Positional[tuple[str, ...]] = ()
    """Policy folders, or NAME=FOLDER; replicas of one name differ in their training seed."""
    worlds: tuple[str, ...] = ("S", "V", "N", "P", "VNP")
    """Built-in worlds' names or world files; the first is the training world."""
    episodes: int = 100
    """Episodes of every policy in every world."""
    controls: tuple[str, ...] = ("shuffled", "frozen", "hole_fixed")
    """Controls: shuffled, frozen, hole_fixed."""
    control_worlds: tuple[str, ...] | None = None
    """Those of --worlds in which the controls are played; where not given, the first and the last."""
    records: tuple[Path, ...] = ()
    """Files of episodes that are there already; they are not played again."""
    measured: Path | None = None
    """CSV of a real robot's trials."""
    robot: str = "robot"
    """The name of the measured target in tables."""
    videos: int = 2
    """Seeds of each policy filmed in the first world and the last, those that are lost on the way first; 0 for none."""
    fine_tuned: bool = False
    """Allow policies that were trained or fine-tuned in a target."""
    seed: int = 0
    """Another number takes other episodes."""
    workers: int = 1
    """Processes."""
    overwrite: bool = False
    """Replace OUT's result."""
    quiet: bool = False
    """No progress bar."""

    @goes_on()
    def run(self) -> int:
        """Plays what is missing, writes the folder, prints the gaps."""
        import json

        from vispeg.cli.evaluation import measured, open_folder, print_table, write_result
        from vispeg.core.errors import UserError
        from vispeg.core.files import write_text_atomic
        from vispeg.evaluation.entrants import EXPERT
        from vispeg.evaluation.gap import gap
        from vispeg.evaluation.players import ready
        from vispeg.evaluation.records import append, read_all
        from vispeg.report.gap import words
        from vispeg.report.gap.build import write

        if not self.policies and not self.records:
            raise UserError("nothing to evaluate", expected="policy folders, or --records FILE")
        who = ready(self.policies) if self.policies else []
        known = read_all(self.records) if self.records else []
        networks = [*((e.name, e.train_seed) for e in who), *((e.policy, e.train_seed) for e in known)]
        robot = measured(self.measured, networks, self.robot)
        names, jobs, played = self._play(who, known) if who else (list(self.worlds), [], [])
        episodes = {e.key: e for e in [*known, *played]}
        every = [*episodes.values(), *robot.episodes]
        targets = [*names, *([self.robot] if robot.episodes else [])]
        scripted = [e.name for e in who if e.scripted] if who else [EXPERT]
        values = gap(every, names[0], targets, self.seed, robot.notes, scripted)
        out = self.out if self.policies else open_folder(self.out, "gap.json", self.overwrite, self._read())
        if not self.policies:
            (out / "episodes.jsonl").unlink(missing_ok=True)
            append(out / "episodes.jsonl", every)
            write_text_atomic(out / "run.json", json.dumps({"policies": {}, "worlds": {}}) + "\n", overwrite=True)
        media = self._films(jobs, list(episodes.values()), names)
        write_text_atomic(out / "media.json", json.dumps(media) + "\n", overwrite=True)
        inputs = [*self.records, *([self.measured] if self.measured else [])]
        values = write_result(out, "gap.json", values, self.seed, inputs)
        page = write(out, overwrite=True)
        shown = {(r["policy"], r["world"]): words.rate(r["success"]) for r in values["success"] if not r["control"]}
        order = [w["name"] for w in values["worlds"]]
        rows = [[p["name"], *(shown.get((p["name"], w), "-") for w in order)] for p in values["policies"]]
        print_table(("policy", *order), rows)
        for row in values["gaps"]:
            print(f"{row['policy']} in {row['world']}: {row['words']}")
        for row in values["measures"]:
            print(f"{row['policy']} in {row['world']}: {row['words']}")
        print(page)
        return 0

    def _read(self) -> list[Path | None]:
        return [*self.records, self.measured]

    def _play(self, who, known):  # type: ignore[no-untyped-def]
        from tempfile import TemporaryDirectory

        from vispeg.cli.evaluation import check_episodes, open_folder, play_all
        from vispeg.core.errors import UserError
        from vispeg.evaluation import stored
        from vispeg.evaluation.controls import CONTROLS
        from vispeg.evaluation.entrants import refuse_trained_on
        from vispeg.evaluation.jobs import Setting, make_jobs, seeds_of
        from vispeg.task.world_file import load_world

        check_episodes(self.episodes, self.workers)
        for control in self.controls:
            if control not in CONTROLS:
                raise UserError("unknown control", key="--controls", got=control, choices=CONTROLS)
        files = [load_world(w) for w in self.worlds]
        names = [f.name for f in files]
        if len(set(names)) < len(names):
            raise UserError("two worlds of one name", key="--worlds", got=", ".join(names))
        places, called = dict(zip(names, self.worlds, strict=True)), dict(zip(self.worlds, names, strict=True))
        chosen = (names[0], names[-1]) if self.control_worlds is None else self.control_worlds
        controlled = dict.fromkeys(called.get(w, w) for w in chosen)
        for name in controlled:
            if name not in places:
                raise UserError("not one of --worlds", key="--control-worlds", got=name, choices=names)
        for file in files[1:]:
            if not self.fine_tuned:
                refuse_trained_on(who, file.name, file.hash, file.path, training=files[0].path)
        settings = [Setting(w, n) for w, n in zip(self.worlds, names, strict=True)]
        settings += [Setting(places[n], n, control=c) for n in controlled for c in self.controls]
        seeds = seeds_of(self.episodes, self.seed)
        if known:
            with TemporaryDirectory() as folder:  # OUT, which may hold the records, is not touched before they fit
                stored.check(make_jobs(who, settings, seeds, Path(folder)), known, self.records)
        read = [*self._read(), *(f.path for f in files), *(e.path for e in who)]
        out = open_folder(self.out, "gap.json", self.overwrite, read)
        if known:
            stored.take_in(known, out)
        jobs = make_jobs(who, settings, seeds, out / "worlds")
        return names, jobs, play_all(jobs, out, self.workers, self.quiet)

    def _films(self, jobs, episodes, names):  # type: ignore[no-untyped-def]
        from vispeg.evaluation.media import film_seeds

        if not self.videos or not jobs:
            return []
        ends = list(dict.fromkeys((names[0], names[-1])))
        return film_seeds(jobs, episodes, ends, self.out / "media", self.videos)
