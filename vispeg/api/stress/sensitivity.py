"""`vispeg sensitivity`: success over one parameter of one effect."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vispeg.api.playing import Playing, check_numbers, folders, other_tolerances, play, silent, stamped
from vispeg.api.stress.result import Stressed
from vispeg.core.cluster import Engine
from vispeg.core.errors import UserError
from vispeg.core.notes import note
from vispeg.core.several import several
from vispeg.evaluation.entrants import Policies
from vispeg.evaluation.folder import EPISODES, workplace
from vispeg.evaluation.jobs import make_jobs, seeds_of
from vispeg.evaluation.players import ready
from vispeg.evaluation.runner import names_of
from vispeg.evaluation.stress import sensitivity as swept
from vispeg.report.gap.stress_pages import sensitivity_page
from vispeg.report.text.summary import Block, Line
from vispeg.task.registry import scene_of
from vispeg.task.world_file import load_world


class SensitivityResult(Stressed):
    """A curve for every sweep and policy, and the value beyond which success is lower; see `Played`."""

    command = holds = "sensitivity"

    @property
    def summary(self) -> list[Block]:
        """One line per curve."""
        return [
            Line(f"{s['label']}, {curve['policy']}: {curve['words']}", path=True)
            for s in self.record["sweeps"]
            for curve in s["curves"]
        ]

    def _render(self) -> str:
        return sensitivity_page(self.record)


def sensitivity(
    policies: Policies,
    sweeps: str | Sequence[str],
    world: str | Path = "nominal",
    *,
    episodes: int = 100,
    seed: int = 0,
    workers: int = 1,
    engine: Engine = "local",
    out: str | Path | None = None,
    overwrite: bool = False,
    playing: Playing = silent,
) -> SensitivityResult:
    """Play policies in a world with one parameter of one effect at each of several values, on the same seeds.

    Args:
        policies, seed, workers, engine, out, overwrite, playing: as in `vispeg.evaluate`.
        sweeps: what to vary, one curve each: a name, EFFECT[@WHERE].PARAM[,PARAM]=VALUE,VALUE,..., a model file
            (success without and with each of its effects), or a measurement (success over the interval of each of its
            effects).
        world: a built-in world's name or a world file.
        episodes: number of episodes per value.

    Raises:
        UserError: as for `vispeg.evaluate`; no sweep, an impossible one, or one that only affects images with a policy
            without cameras.
    """
    check_numbers(episodes, workers)
    sweeps = several(sweeps)
    if not sweeps:
        raise UserError("nothing to sweep", key="--sweep", expected="a sweep", choices=swept.SWEEPS)
    who, file = ready(policies), load_world(world)
    chosen = [sweep for text in sweeps for sweep in swept.sweeps(str(text), file.world.base.robot)]
    swept.refuse_unseen(chosen, who)
    swept.refuse_elsewhere(chosen, scene_of(file.task))
    for text in other_tolerances(who, [file]):
        note(text)
    read = [file.path, *folders(who)]
    with workplace(out, "sensitivity.json", overwrite, read) as place:
        settings = [s for sweep in chosen for s in swept.settings(str(world), file.name, sweep)]
        ends = play(
            make_jobs(who, settings, seeds_of(episodes, seed), place / "worlds"), place, workers, playing, engine
        )
        about = {
            "format": swept.FORMAT,
            "world": {"name": file.name, "hash": file.hash},
            "sweeps": swept.summarise(ends, chosen),
        }
        result = SensitivityResult(
            stamped(about, seed, folders(who)), tuple(ends), (), tuple(read), names_of(place / EPISODES)
        )
        if out is not None:
            result._write(place)
    return result
