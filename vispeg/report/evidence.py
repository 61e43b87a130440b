"""The arrays behind a report, measured and predicted, read from `evidence.npz`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError
from vispeg.diagnosis.traces import Trace
from vispeg.formats.arrays import read_arrays
from vispeg.formats.format import enrol
from vispeg.formats.guard import as_written
from vispeg.report.live.arm import picked

AXES = ("speed", "load", "position", "phase", "time", "frequency")


@dataclass(frozen=True)
class ResidualMap:
    """RMS residual of each joint in bins of one variable, as a multiple of the noise.

    Attributes:
        axis: the variable: speed or load (as a share of the joint's peak), position (rad), phase (0 at the lower, 0.5
            at the upper turning point), time (s) or frequency (Hz).
        edges: (k+1,) bin edges.
        before, after: (nj, k) with the given and the identified model; NaN in bins without data; `after` may be None.
    """

    axis: str
    edges: np.ndarray
    before: np.ndarray
    after: np.ndarray | None


@dataclass(frozen=True)
class NextMotion:
    """The proposed experiment: time (n,), s; command (n, nj), rad; predictions a, b (n, nj) of two rivals, or None."""

    time: np.ndarray
    command: np.ndarray
    a: np.ndarray | None
    b: np.ndarray | None


@dataclass(frozen=True)
class Choices:
    """Held-out residuals of m models: with some or all of the k effects that were added, and rival models.

    Attributes:
        effects: (k,) name and place of each effect.
        on: (m, k) whether the model includes the effect.
        rivals: (m,) name of a rival model; "" for others, of which the last has all effects.
        error: (m,) held-out RMS error, in the evidence's unit.
        joints: (m, nj) the same for each joint.
        residuals: for each recording its name, time (p,), s, and measured minus predicted values (m, p, nj).
    """

    effects: tuple[tuple[str, str], ...]
    on: np.ndarray
    rivals: tuple[str, ...]
    error: np.ndarray
    joints: np.ndarray
    residuals: tuple[tuple[str, np.ndarray, np.ndarray], ...]


@dataclass(frozen=True)
class Evidence:
    """All arrays of a report; empty without an evidence file.

    Attributes:
        joints: names of the columns of traces and maps.
        unit: of the values of `traces`.
        traces: held-out recordings, or their episodes; no two have the same name.
        torques: torques of those of them that have any, under the same names.
        maps: RMS residuals by variable, see `ResidualMap`.
        next_motion: the proposed experiment.
        choices: residuals of the models with some of the found effects.
        pictures: what `vispeg.vision.show.pictures` returns: `picture/k/NAME` (H, W, 3) uint8, pictures of the k-th
            frame that is shown, and `camera/c/NAME`, residuals of the c-th camera.
        views: `view/k/NAME` and `projection/c/NAME` of a diagnosis of pictures, as `vispeg.report.sections.views` draws
            them: pictures of the k-th view, and shifts of the c-th camera's pixels.
        phase_names: of contact; a trace's `regime` is an index into them.
        worst: PNG of the cell at the moment of the largest error.
        worst_moment: recording, time and phase of that error.
        arm: arrays of the interactive arm, see `vispeg.report.live.arm`.
        by_channel: evidence of each of several channels.
    """

    joints: tuple[str, ...] = ()
    unit: str = "rad"
    traces: tuple[Trace, ...] = ()
    torques: tuple[Trace, ...] = ()
    maps: Mapping[str, ResidualMap] = field(default_factory=dict)
    next_motion: NextMotion | None = None
    choices: Choices | None = None
    pictures: Mapping[str, np.ndarray] = field(default_factory=dict)
    views: Mapping[str, np.ndarray] = field(default_factory=dict)
    phase_names: tuple[str, ...] = ()
    worst: bytes | None = None
    worst_moment: str = ""
    arm: Mapping[str, np.ndarray] = field(default_factory=dict)
    by_channel: Mapping[str, Evidence] = field(default_factory=dict)

    @property
    def pairs(self) -> tuple[tuple[Trace, Trace | None], ...]:
        """Each trace with its torques; None for one without."""
        torques = {t.name: t for t in self.torques}
        return tuple((t, torques.get(t.name)) for t in self.traces)

    @property
    def every(self) -> tuple[Trace, ...]:
        """All traces of all channels, each followed by its torques if it has any."""
        own = (t for pair in self.pairs for t in pair if t is not None)
        return (*own, *(t for other in self.by_channel.values() for t in other.every))


def _example(folder: Path) -> Path:
    time = np.arange(8) / 100.0
    arrays = {"joints": np.array(["a", "b"]), "unit": np.array("rad"), "0/name": np.array("rig"), "0/time": time}
    arrays |= {f"0/{key}": np.ones((8, 2)) for key in ("measured", "before", "after")}
    arrays |= {"map/speed/edges": np.linspace(-1, 1, 4), "map/speed/before": np.ones((2, 3))}
    arrays |= {"next/time": time, "next/q_cmd": np.zeros((8, 2))}
    arrays |= {"choice/on": np.array([[False], [True]]), "choice/effect": np.array(["coulomb_friction"])}
    arrays |= {
        "choice/where": np.array(["a"]),
        "choice/rival": np.array(["", ""]),
        "choice/error": np.array([2.0, 1.0]),
    }
    arrays |= {"choice/joints": np.ones((2, 2)), "choice/0/time": time, "choice/0/residual": np.ones((2, 8, 2))}
    np.savez(folder / "evidence.npz", **arrays)
    return folder / "evidence.npz"


@enrol("evidence.npz", _example)
def load_evidence(path: Path) -> Evidence:
    """Read `evidence.npz`; return empty evidence if it does not exist. Raises UserError: an invalid file or shape."""
    if not path.exists():
        return Evidence()
    arrays = read_arrays(path)
    with as_written(path, "vispeg diagnose"):
        return _read(path, arrays)


def evidence_of(arrays: Mapping[str, np.ndarray]) -> Evidence:
    """Return the evidence in arrays with the names of `evidence.npz`."""
    return _read(Path("evidence.npz"), arrays)


def _read(path: Path, arrays: Mapping[str, np.ndarray]) -> Evidence:
    channels: dict[str, dict[str, np.ndarray]] = {}
    for key, value in arrays.items():
        if key.startswith(("channel/", "room/")) and key.count("/") > 1:  # older files say room for channel
            _, name, rest = key.split("/", 2)
            channels.setdefault(name, {})[rest] = value
    each = {name: _Reader(path, inner).evidence() for name, inner in channels.items()}
    return replace(_Reader(path, dict(arrays)).evidence(), by_channel=each)


class _Reader:
    """Sort arrays into Evidence, and check their shapes."""

    def __init__(self, path: Path, arrays: dict[str, np.ndarray]):
        self.path, self.arrays = path, arrays
        self.joints = tuple(str(name) for name in np.atleast_1d(arrays.get("joints", np.array([], dtype=str))))

    @cached_property
    def names(self) -> dict[int, str]:
        """Name of each trace by its number in the file; repeated names get a suffix: `rig`, `rig, number 2`."""
        out, taken = {}, Counter[str]()
        for r in sorted({int(key.split("/")[0]) for key in self.arrays if key.split("/")[0].isdigit()}):
            name = self.text(f"{r}/name", f"held-out {r + 1}")
            taken[name] += 1
            out[r] = name if taken[name] == 1 else f"{name}, number {taken[name]}"
        return out

    def evidence(self) -> Evidence:
        unit = self.text("unit", "rad")
        traces, torques = [], []
        for r, name in self.names.items():
            time = self.need(f"{r}/time")
            traces.append(self.trace(r, "", name, unit, time))
            if f"{r}/measured_tau" in self.arrays and f"{r}/before_tau" in self.arrays:
                torques.append(self.trace(r, "_tau", name, "N m", time))
        maps = {axis: self.map(axis) for axis in AXES if f"map/{axis}/before" in self.arrays}
        pictures = {k: v for k, v in self.arrays.items() if k.startswith(("picture/", "camera/"))}
        for key, image in pictures.items():
            if key.startswith("picture/") and (image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8):
                got = f"{image.shape} {image.dtype}"
                raise UserError("is not a picture", file=self.path, key=key, expected="(H, W, 3) uint8", got=got)
        views = {k: v for k, v in self.arrays.items() if k.startswith(("view/", "projection/"))}
        phase_names = tuple(str(n) for n in self.arrays.get("phases", ()))
        png = self.arrays["worst/png"].astype(np.uint8).tobytes() if "worst/png" in self.arrays else None
        return Evidence(
            joints=self.joints,
            unit=unit,
            traces=tuple(traces),
            torques=tuple(torques),
            maps=maps,
            next_motion=self.next(),
            choices=self.choices(),
            pictures=pictures,
            views=views,
            phase_names=phase_names,
            worst=png,
            worst_moment=self.text("worst/moment", ""),
            arm=picked(self.arrays),
        )

    def choices(self) -> Choices | None:
        if "choice/on" not in self.arrays:
            return None
        on, nj = self.need("choice/on").astype(bool), len(self.joints)
        m = len(on)
        effects = [[str(v) for v in self.arrays.get(f"choice/{key}", ())] for key in ("effect", "where")]
        rivals = tuple(str(v) for v in self.arrays.get("choice/rival", ()))
        for key, got in (("effect", len(effects[0])), ("where", len(effects[1])), ("rival", len(rivals))):
            expected = m if key == "rival" else on.shape[-1]
            if got != expected:
                raise UserError("has the wrong length", file=self.path, key=f"choice/{key}", expected=expected, got=got)
        residuals, r = [], 0
        while f"choice/{r}/time" in self.arrays:
            time = self.need(f"choice/{r}/time")
            values = self.need(f"choice/{r}/residual", (m, len(time), nj))
            residuals.append((self.names.get(r, f"held-out {r + 1}"), _end_to_end(time), values))
            r += 1
        error, joints = self.need("choice/error", (m,)), self.need("choice/joints", (m, nj))
        return Choices(tuple(zip(*effects, strict=True)), on, rivals, error, joints, tuple(residuals))

    def text(self, key: str, default: str) -> str:
        return str(self.arrays[key]) if key in self.arrays else default

    def need(self, key: str, shape: tuple[int, ...] | None = None) -> np.ndarray:
        """Return an array as float. Raises UserError: it is missing, or its shape is not `shape`."""
        if key not in self.arrays:
            raise UserError("is missing", file=self.path, key=key)
        value = self.arrays[key]
        if shape is not None and value.shape != shape:
            raise UserError("has the wrong shape", file=self.path, key=key, expected=shape, got=value.shape)
        return value.astype(float)

    def maybe(self, key: str, shape: tuple[int, ...]) -> np.ndarray | None:
        return self.need(key, shape) if key in self.arrays else None

    def trace(self, r: int, suffix: str, name: str, unit: str, time: np.ndarray) -> Trace:
        shape = (len(time), len(self.joints))
        measured, before = self.need(f"{r}/measured{suffix}", shape), self.need(f"{r}/before{suffix}", shape)
        after, posture = self.maybe(f"{r}/after{suffix}", shape), self.maybe(f"{r}/posture", shape)
        noise = self.need(f"{r}/sigma{suffix}") if f"{r}/sigma{suffix}" in self.arrays else None
        regime = self.arrays[f"{r}/phase"].astype(int) if f"{r}/phase" in self.arrays else None
        channel = self.text(f"{r}/channel{suffix}", "")
        return Trace(
            name, unit, _end_to_end(time), measured, before, after, posture, noise, regime, channel, bool(suffix)
        )

    def map(self, axis: str) -> ResidualMap:
        edges = self.need(f"map/{axis}/edges")
        shape = (len(self.joints), len(edges) - 1)
        after = self.maybe(f"map/{axis}/after", shape)
        return ResidualMap(axis, edges, self.need(f"map/{axis}/before", shape), after)

    def next(self) -> NextMotion | None:
        if "next/time" not in self.arrays or "next/q_cmd" not in self.arrays:
            return None
        time = self.need("next/time")
        shape = (len(time), len(self.joints))
        a, b = self.maybe("next/A", shape), self.maybe("next/B", shape)
        return NextMotion(_end_to_end(time), self.need("next/q_cmd", shape), a, b)


def _end_to_end(time: np.ndarray) -> np.ndarray:
    """Return times (n,), s, that continue where the given times restart with an episode."""
    step = np.diff(time, prepend=time[:1])
    if step.size and np.any(step < 0):
        step = np.where(step < 0, np.median(step[step > 0]) if np.any(step > 0) else 0.0, step)
        return time[0] + np.cumsum(step)
    return time
