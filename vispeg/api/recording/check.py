"""Check recordings, as `vispeg check` does."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypedDict

from vispeg.api.recording.contact import check_contact
from vispeg.api.result import Result
from vispeg.channels.pictures import seen
from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.core.provenance import here
from vispeg.core.several import each_once, several
from vispeg.diagnosis.pictures.coverage import excitations
from vispeg.diagnosis.pictures.excited import Excitation
from vispeg.identify.pictures.read import comparable
from vispeg.recordings.checks.check import SIGNALS, CheckReport
from vispeg.recordings.checks.check import check as examine
from vispeg.recordings.checks.contact_check import said, together
from vispeg.recordings.checks.plot import plot
from vispeg.recordings.checks.quality import Limits
from vispeg.recordings.importers.fits import Needs
from vispeg.recordings.load import load
from vispeg.recordings.noise import noise_from_repeats, same_motion
from vispeg.recordings.recording import Recording
from vispeg.recordings.schema import Header
from vispeg.report.checked.examined import Examined, examined
from vispeg.report.checked.page import render
from vispeg.report.checked.tables import camera_blocks, recording_blocks
from vispeg.report.text.summary import Block, Line
from vispeg.robots.model import load as load_robot
from vispeg.robots.model import load_for
from vispeg.robots.scene import Scene
from vispeg.sim.units import needs_of
from vispeg.task.belief import scene_of
from vispeg.vision.check import CameraCheck, check_frames
from vispeg.vision.eye import posed
from vispeg.worlds.world import World

HEAD = 20_000  # number of rows of each recording that are compared with the others
Share = Callable[[float], None]
Watch = Callable[[str, Path], AbstractContextManager[Share]]


class Repeated(TypedDict):
    """Folders of recordings that repeat one commanded motion, and each joint's noise that follows from them, rad."""

    recordings: list[str]
    noise_q: list[float]


@dataclass(frozen=True, repr=False)
class Checks(Result):
    """Findings on recordings; all lists have one entry per recording unless stated.

    Attributes:
        reports: findings on joints and contact.
        cameras: findings on each camera; empty without frames.
        excited: change of the pictures by effects of camera, sensor and arm; empty if unknown.
        stated: whether the recording describes its cell.
        repeats: groups of recordings that repeat one motion.
        pages: data of the recording's page; empty if nothing was drawn.
        drawings: file name -> PNG of a recording; empty if nothing was drawn.
        sources: folders of the recordings.
    """

    reports: Sequence[CheckReport]
    cameras: Sequence[Sequence[CameraCheck]]
    excited: Sequence[Sequence[Excitation]]
    stated: Sequence[bool]
    repeats: Sequence[Repeated]
    pages: Sequence[Examined]
    drawings: Mapping[str, bytes]
    sources: tuple[str | Path, ...]
    holds = "check"  # class attribute, see `Result`

    @property
    def record(self) -> Mapping[str, object]:
        """Content of check.json."""
        entries = [
            {**report.to_json(), **_of_pictures(cameras, excited)}
            for report, cameras, excited in zip(self.reports, self.cameras, self.excited, strict=True)
        ]
        return {"format": "vispeg-check/1", "recordings": entries, "repeats": list(self.repeats)}

    @property
    def summary(self) -> list[Block]:
        """Two tables per recording, more if there are pictures, and warnings."""
        blocks = list[Block]()
        each = zip(self.reports, self.cameras, self.excited, self.stated, strict=True)
        for report, cameras, excited, stated in each:
            blocks += [*recording_blocks(report), *camera_blocks(cameras, excited, stated)]
        touched = [report.contact for report in self.reports if report.contact is not None]
        if len(touched) > 1:
            blocks += [Line("together:"), *(Line(f"  {line}") for line in said(touched[0], together(touched)))]
        for group in self.repeats:
            noise = " ".join(f"{value:.2g}" for value in group["noise_q"])
            text = f"repeats of one motion: {', '.join(group['recordings'])}; noise of q {noise}"
            blocks.append(Line(text, path=True))
        return blocks

    def _write(self, folder: Path) -> None:
        text = json.dumps(self.record, indent=2, allow_nan=False) + "\n"
        (folder / "check.json").write_text(text, encoding="utf-8")
        for name, drawing in self.drawings.items():
            (folder / name).write_bytes(drawing)
        if self.pages:
            page = render(self.pages, self.repeats, here(None, {})["command"])
            (folder / "report.html").write_text(page, encoding="utf-8")


def check(
    recordings: str | Path | Sequence[str | Path],
    *,
    out: str | Path | None = None,
    overwrite: bool = False,
    watch: Watch = lambda what, path: nullcontext(lambda share: None),
) -> Checks:
    """Check recording folders, one after the other, so that only one is in memory.

    Args:
        recordings: recording folders.
        out: folder for report.html, check.json and a picture of each recording; default: nothing is drawn.
        overwrite: replace `out` if it exists.
        watch: called with a stage and the recording; returns a context manager, which yields a function of the share
            done.

    Raises:
        UserError: a recording cannot be used or is given twice, or `out` exists.
    """
    paths = [Path(path) for path in several(recordings)]
    if not paths:
        raise UserError("no recording given", expected="at least one folder")
    each_once(paths)
    if out is None:
        return _examined(paths, False, watch)
    with new_folder(out, overwrite, holds=Checks.holds, inputs=paths) as folder:
        checks = _examined(paths, True, watch)
        checks._write(folder)
    return checks


def limits_of(rec: Recording) -> Limits:
    """Return the robot's limits in the recording's joint order. Raises UserError: no such robot or joint."""
    file = rec.path / "recording.yaml"
    try:
        robot = load_robot(rec.robot)
    except UserError as error:  # attribute the error to the recording's key
        raise UserError(str(error), file=file, key="robot") from error
    for joint in rec.joints:
        if joint not in robot.joints:
            raise UserError("the robot has no such joint", file=file, key="joints", got=joint, choices=robot.joints)
    return Limits.of(robot, rec.joints)


def _examined(paths: Sequence[Path], drawn: bool, watch: Watch) -> Checks:
    """Check the recordings; if `drawn`, also make their pictures and the data of their pages."""
    reports, heads, cameras, excited, stated = [], [], [], [], []
    pages, drawings = list[Examined](), dict[str, bytes]()
    for number, path in enumerate(paths, start=1):
        with watch("reading", path) as share:
            rec = load(path, _signals, share)
        limits = limits_of(rec)
        rec = rec if rec.frames is None else replace(rec, frames=posed(rec.frames, load_robot(rec.robot)))
        with watch("examining", path) as share:
            contact, touched = check_contact(rec) or (None, None)
            reports.append(replace(examine(rec, limits, share, _needs(rec)), contact=contact))
        heads.append(_head(rec))
        scene = _scene_of(rec)
        cameras.append(_cameras(rec, scene, watch))
        excited.append(_excited(rec, scene, watch))
        stated.append(scene is not None or rec.cell is not None)
        if drawn:
            name = "check.png" if len(paths) == 1 else f"check-{number}-{rec.name}.png"
            drawings[name] = plot(rec, reports[-1], limits)
            looked = cameras[-1], excited[-1]
            pages.append(examined(rec, reports[-1], limits, looked, stated[-1], touched, drawings[name]))
        del rec
    return Checks(reports, cameras, excited, stated, _repeats(heads), pages, drawings, tuple(paths))


def _needs(rec: Recording) -> Needs | None:
    """Return the torques needed by the robot with the recording's tool and tilt; None if these cannot be read."""
    try:
        return needs_of(load_for(rec.joints, rec.robot, rec.tool, rec.base_tilt), rec)
    except UserError:
        return None


def _signals(header: Header) -> tuple[str, ...]:
    """Return the signals to read; wrench and commanded flange poses only if the recording states how to read them."""
    return (*SIGNALS, "ft", "ee_cmd") if header.wrench is not None or header.cell is not None else SIGNALS


def _scene_of(rec: Recording) -> Scene | None:
    """Return the scene around the arm that a recording with frames states, with its cameras; None if it states none."""
    world = World(rec.robot, rec.tool, cell=None if rec.cell is None or rec.cell.bench else rec.cell)
    if rec.frames is None or not seen(world, rec):
        return None
    scene = scene_of(world, rec)
    return replace(scene, cameras=tuple(rec.frames.names)) if scene.joints == tuple(rec.joints) else None


def _cameras(rec: Recording, scene: Scene | None, watch: Watch) -> list[CameraCheck]:
    """Check each camera's frames against the recording's scene, if known; return [] without frames."""
    if rec.frames is None:
        return []
    with watch("looking at the frames of", rec.path) as share:
        return check_frames(rec, scene, share)


def _excited(rec: Recording, scene: Scene | None, watch: Watch) -> list[Excitation]:
    """Return the change that each effect would make to a recording's images; empty without a known cell."""
    if scene is None or not comparable(rec):
        return []
    with watch("seeing which effects would show in", rec.path) as share:
        return excitations(scene, rec, World(rec.robot, cell=rec.cell), share)


def _of_pictures(cameras: Sequence[CameraCheck], excited: Sequence[Excitation]) -> Mapping[str, object]:
    """Return the part of check.json on pictures; empty without frames."""
    if not cameras:
        return {}
    return {"cameras": [c.to_json() for c in cameras], "excited": [x.as_dict() for x in excited]}


def _head(rec: Recording) -> Recording:
    """Copy the first HEAD rows of a recording, enough to compare repeats, so that the rest can be freed."""
    arrays = ("time", "q", "q_cmd", "tau_cmd", "episode")
    cut = {name: value[:HEAD].copy() for name in arrays if (value := getattr(rec, name)) is not None}
    return replace(rec, tau=None, ft=None, frames=None, **cut)


def _repeats(recs: Sequence[Recording]) -> list[Repeated]:
    """Return the groups of two recordings or more that repeat one motion."""
    remaining, out = list(recs), list[Repeated]()
    while remaining:
        group = [remaining[0], *(rec for rec in remaining[1:] if same_motion(remaining[0], rec))]
        remaining = [rec for rec in remaining if not any(rec is other for other in group)]
        if len(group) > 1:
            noise = noise_from_repeats(group, "q").tolist()
            out.append({"recordings": [str(rec.path) for rec in group], "noise_q": noise})
    return out
