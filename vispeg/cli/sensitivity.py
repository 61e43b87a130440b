"""Success against one parameter of one effect, as a curve with bands: how wrong may a camera be, how late a command.

SWEEP is focal-length, camera-shift, camera-turn, depth-noise, light, latency, image-latency, encoder-noise, force-bias,
force-noise, friction, or EFFECT[@WHERE].PARAM[,PARAM]=VALUE,VALUE,... What only images show is swept with policies that
see. Writes OUT/sensitivity.json and OUT/sensitivity.html.

Example:
    vispeg sensitivity runs/depth/best --world S --sweep focal-length --episodes 200 --out focal
    vispeg sensitivity runs/d/best runs/r/best --sweep "camera_offset@wrist_wide.x=0,0.005,0.02" --out shift
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.output import Output, Told
from vispeg.core.interrupt import goes_on


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg sensitivity`."""

    policies: tyro.conf.Positional[tuple[str, ...]]
    """Policy folders, or NAME=FOLDER."""
    out: Path
    """Folder for the results."""
    sweep: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """What is swept; give the flag once for each curve."""
    world: str = "nominal"
    """A built-in world's name or a world file."""
    episodes: int = 100
    """Episodes a value."""
    seed: int = 0
    """Another number takes other episodes."""
    workers: int = 1
    """Processes."""
    overwrite: bool = False
    """Replace OUT's result."""
    output: Told = Output()

    @goes_on()
    def run(self) -> int:
        """Plays what is missing, writes the folder, prints a line a curve."""
        from vispeg.api.playing import check_numbers
        from vispeg.cli.evaluation import open_folder, play_all, write_result
        from vispeg.core.errors import UserError
        from vispeg.core.files import write_text_atomic
        from vispeg.evaluation import sensitivity
        from vispeg.evaluation.jobs import make_jobs, seeds_of
        from vispeg.evaluation.players import ready
        from vispeg.report.gap.sweep_page import render
        from vispeg.task.world_file import load_world

        check_numbers(self.episodes, self.workers)
        if not self.sweep:
            raise UserError("nothing to sweep", key="--sweep", expected="a sweep", choices=sensitivity.SWEEPS)
        who, world = ready(self.policies), load_world(self.world)
        sweeps = [sensitivity.sweep(text) for text in self.sweep]
        sensitivity.refuse_unseen(sweeps, who)
        out = open_folder(self.out, "sensitivity.json", self.overwrite, [world.path, *(e.path for e in who)])
        settings = [s for what in sweeps for s in sensitivity.settings(self.world, world.name, what)]
        jobs = make_jobs(who, settings, seeds_of(self.episodes, self.seed), out / "worlds")
        episodes = play_all(jobs, out, self.workers, self.output.quiet)
        found = []
        for what in sweeps:
            tags = {sensitivity.tag(what, v) for v in what.values}
            found.append(sensitivity.summarise([e for e in episodes if e.configuration in tags], what))
        values = {"format": sensitivity.FORMAT, "world": {"name": world.name, "hash": world.hash}, "sweeps": found}
        values = write_result(out, "sensitivity.json", values, self.seed, [e.path for e in who if e.path.exists()])
        page = write_text_atomic(out / "sensitivity.html", render(values), overwrite=True)
        lines = [f"{s['label']}, {curve['policy']}: {curve['words']}" for s in found for curve in s["curves"]]
        self.output.give(values, [*lines, str(page)])
        return 0
