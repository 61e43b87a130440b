"""HTML for parts of the page that the toolkit has no element for; text from files is escaped."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vispeg.report.page import templates
from vispeg.report.record import rows
from vispeg.report.sections.found import share, without
from vispeg.report.sections.maps import LABELS, SHADES, rounded
from vispeg.report.text import words
from vispeg.report.text.effect_words import sized
from vispeg.report.text.quantities import plain, prefix, quantity
from vispeg.view.diagnose.standing import Field, Standing, Tried

if TYPE_CHECKING:
    from vispeg.evaluation.films.moments import Moment
    from vispeg.trials.live import State
    from vispeg.trials.trial import Said
    from vispeg.view.frames import Frame, Holding
    from vispeg.view.importing import Look, Proposed
    from vispeg.view.run_folder import Run


WIDEST = 14  # most characters of a row's name beside the map
AXES = {k: v for k, v in LABELS.items() if k != "frequency"} | {"contact": "phase of contact", "part": "part"}


def _page(template: str, **values: object) -> str:
    return templates("vispeg.view").get_template(f"{template}.html.j2").render(values)


def style() -> str:
    """Return the style sheet; add it once per page."""
    return _page("style")


def below() -> str:
    """Return the link to the page's second panel, which is below the first one in a narrow window."""
    return _page("below")


def window(target: str) -> str:
    """Return the script that runs once per window (window.js); it writes into the field whose label is for `target`."""
    environment = templates("vispeg.view")
    assert environment.loader is not None
    script, _, _ = environment.loader.get_source(environment, "window.js")
    return _page("window", target=target, script=script)


def note(text: str) -> str:
    """Return text as a paragraph."""
    return _page("note", text=text)


def reported(text: str, record: Mapping[str, Any]) -> str:
    """Return text as a paragraph, and what each effect of a record explains, in the words of the report."""
    effects = [(sized(e), share(e), without(e)) for e in rows(record, "effects")]
    return _page("reported", text=text, effects=effects)


def next_step(title: str, text: str, steps: tuple[str, ...] = (), at: int = 0) -> str:
    """Return the instruction for the next step, below a list of all steps; `at` is the number of the current one."""
    parts = text.split("`")  # every other part names an element of the page
    return _page("next", title=title, parts=parts, steps=steps, at=at)


def distinct(names: Sequence[str]) -> list[str]:
    """Return names without the words that all of them begin or end with.

    `panda_joint1`, `panda_joint2` become `joint1`, `joint2`; `shoulder_pan_joint`, `elbow_joint` lose `joint`.
    """
    words = [re.split(r"([_\-./ ]+)", name) for name in names]  # words at even places, separators between them
    if len(set(names)) < 2:
        return list(names)
    for end in (0, -1):
        while min(len(w) for w in words) > 2 and len({w[end] for w in words}) == 1:
            words = [w[2:] if end == 0 else w[:-2] for w in words]
    return ["".join(w) for w in words]


def error(text: str) -> str:
    """Return an error message, in the style of the command line."""
    return _page("error", text=text)


def commands(lines: list[str]) -> str:
    """Return command lines, each with a button that copies it."""
    return _page("commands", lines=lines)


def ladder(standing: Standing) -> str:
    """Return the present error, and its decrease model by model."""
    errors = [rung.error for rung in standing.ladder]
    high, low = max(errors), min([*errors, standing.floor or min(errors)]) / 1.6
    low = min(low, high / 10) or 1e-12  # the bars have a logarithmic axis of at least a decade

    def at(value: float) -> float:
        return round(100 * float(np.clip(np.log(value / low) / np.log(high / low), 0, 1)), 1) if value > 0 else 0.0

    rows = []
    for i, rung in enumerate(standing.ladder):
        change = words.change(errors[i - 1], rung.error) if i else ""
        rows.append((rung.words, quantity(rung.error, f"{standing.unit}"), change, at(rung.error)))
    against = words.against_floor(errors[-1], standing.floor)
    now = quantity(errors[-1], f"{standing.unit} RMS")
    floor = at(standing.floor) if standing.floor else None
    held_out = "held-out error" if standing.judged else "error"
    return _page("ladder", now=now, against=against, rows=rows, floor=floor, name=held_out, effects=standing.effects)


def heat(standing: Standing, axis: str, chosen: str, target: str) -> str:
    """Return a map as buttons; each press writes `COLUMN, TRACK TIME` into the field whose label is for `target`."""
    field = standing.maps[axis]
    top = max(float(np.nanmax(field.first, initial=3.0)), 3.0)
    rows, short = [], distinct(standing.columns)
    for j, column in enumerate(standing.columns):
        cells = [_cell(standing, field, j, i, top, column) for i in range(field.now.shape[1])]
        rows.append((column, short[j], cells))
    edges = [plain(e, 2) for e in rounded(np.asarray(field.edges))]
    ends = field.labels or (edges[0], edges[len(edges) // 2], edges[-1])
    words = {"shows": standing.shows, "label": AXES[axis], "chosen": chosen, "target": target}
    wide = min(max(map(len, short)), WIDEST)
    return _page("heat", rows=rows, ends=ends, each=bool(field.labels), wide=wide, **words)


def _cell(standing: Standing, field: Field, j: int, i: int, top: float, column: str) -> dict[str, str] | None:
    """Return the button of column j in cell i, coloured on a log scale from 1 to `top`; None for an empty cell.

    `go` is the text that it writes into the field.
    """
    value = float(field.now[j, i])
    if not np.isfinite(value) or not np.isfinite(field.moment[j, i]).all():
        return None
    track, time = int(field.moment[j, i, 0]), float(field.moment[j, i, 1])
    low, high = (plain(edge, 2) for edge in rounded(np.asarray(field.edges))[i : i + 2])
    cell = field.labels[i] if field.labels else f"{low} to {high}"
    share = float(np.clip(np.log(max(value, 1.0)) / np.log(top), 0, 1))
    colour, dark = _shade(share)
    title = f"{column}, {cell}: {plain(value, 2)} times the noise; {standing.tracks[track].name}, {time:.2f} s"
    go = f"{column}, {track + 1} {time:.3f}"
    text = f"{value:.1f}" if value < 9.95 else f"{value:.0f}" if value < 999.5 else f"{value / 1000:.0f}k"
    return {"go": go, "title": title, "colour": colour, "ink": "#fff" if dark else "#16181d", "text": text}


def _shade(share: float) -> tuple[str, bool]:
    """Return a colour of the reports' scale, and whether it is so dark that text on it must be white."""
    parts = np.array([[int(c[k : k + 2], 16) for k in (1, 3, 5)] for c in SHADES], float)
    x = share * (len(parts) - 1)
    k = min(int(x), len(parts) - 2)
    rgb = parts[k] + (x - k) * (parts[k + 1] - parts[k])
    return "#" + "".join(f"{round(v):02x}" for v in rgb), float(rgb @ (0.299, 0.587, 0.114)) < 125


def tried(trials: list[Tried], said: list[str], unit: str) -> str:
    """Return the fitted candidates with errors and reasons for refusal, the newest first, and the log lines `said`."""
    rows = []
    for t in reversed(trials):
        factor, name = prefix(max(t.before, t.after), unit)
        text = f"{plain(factor * t.before)} to {plain(factor * t.after)} {name}"
        rows.append((t.words, t.size, text, t.refused))
    return _page("tried", rows=rows, said=said)


def episode(sides: list[tuple[str, Moment, str]]) -> str:
    """Return one moment of an episode in each world, and the episode's outcome there."""
    rows = []
    for world, moment, ends in sides:
        force = plain(float(np.linalg.norm(moment.force)), 2)
        estimate = "" if moment.estimate is None else _three(moment.estimate)
        row = {"world": world, "time": f"{moment.time:.2f}", "force": force, "offset": _three(moment.offset)}
        rows.append({**row, "estimate": estimate, "outcome": moment.outcome, "ends": "" if moment.outcome else ends})
    return _page("episode", sides=rows)


def _three(values: np.ndarray) -> str:
    """Return the numbers of a vector, with signs and one decimal."""
    return ", ".join(f"{v:+.1f}" for v in values)


def columns(proposed: Proposed) -> str:
    """Return the proposed meaning of a log's columns, with reasons."""
    return _page("columns", lines=proposed.lines, remarks=proposed.remarks)


def doubts(look: Look) -> str:
    """Return the values that are impossible in the chosen units."""
    return _page("doubts", samples=look.samples, joints=len(look.joints), rate=f"{look.rate_hz:g}", doubts=look.doubts)


def run(run: Run) -> str:
    """Return the progress of a training run."""
    steps = run.curves.get("steps", np.zeros(0))
    last = {"steps": f"{steps[-1]:.0f}", "success": f"{100 * run.curves['success'][-1]:.0f}"} if len(steps) else {}
    return _page(
        "run", name=run.folder.name, rows=len(steps), failures=run.failures, **{"steps": "", "success": "", **last}
    )


def live(state: State) -> str:
    """Return the state of a run on a robot."""
    return _page("live", s=state, **_numbers(state))


def _numbers(state: State) -> dict[str, object]:
    """Return the numbers of a step to show: tip (mm), distance to the target (mm), share of each limit (%), wrench."""
    if state.tip_m is None or state.pose is None or state.target is None:
        return {}
    apart = 1e3 * float(np.linalg.norm(np.subtract(state.target[:3], state.pose[:3])))
    shares = [(name, min(100, round(100 * share)), f"{100 * share:.0f} %") for name, share in state.shares.items()]
    felt = None if state.wrench is None else [_three(np.array(state.wrench[i : i + 3])) for i in (0, 3)]
    return {"tip": _three(1e3 * np.array(state.tip_m)), "apart": f"{apart:.1f}", "shares": shares, "felt": felt}


def trials(said: Mapping[str, Said]) -> str:
    """Return the trials of a folder, the newest first, and the number of successes."""
    rows = []
    for name, trial in reversed([*said.items()]):
        o, t = trial.outcome, trial.timing
        force = "" if o.peak_force_n is None else f"{o.peak_force_n:.0f} N"
        late = f"{t.missed} of {t.steps}" if t.steps else ""
        rows.append((name, o.category, o.success, f"{o.time_s:.1f} s", force, late, o.why or ""))
    return _page("trials", rows=rows, good=sum(trial.outcome.success for trial in said.values()))


def film(name: str, data: bytes) -> str:
    """Return a film, embedded in the page."""
    return _page("film", name=name, data=base64.b64encode(data).decode())


def frame(frame: Frame, holding: Holding) -> str:
    """Return the description of a dataset's frame: place, numbers, colours of the parts, and drawn values."""
    from vispeg.report.dataset.pictures import part_picture

    colours = part_picture(np.arange(1, len(holding.parts) + 1)) if holding.parts else np.zeros((0, 3), int)
    key = [(name, "rgb({},{},{})".format(*c)) for name, c in zip(holding.parts, colours, strict=True)]
    return _page("frame", frame=frame, holding=holding, key=key)


def draws(spread: Mapping[str, object]) -> str:
    """Return histograms of the values drawn over all episodes of a dataset."""
    return _page("draws", **spread)


def drawn(values: list[tuple[str, str]]) -> str:
    """Return the values drawn for an episode."""
    return _page("drawn", values=values)
