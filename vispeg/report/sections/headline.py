"""The verdict in plain words, the fall of the held-out error, and what was found."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from vispeg.report import words
from vispeg.report.figures import AFTER, BEFORE, MEASURED, MUTED, legend, new_figure, quiet, styled, svg
from vispeg.report.quantities import fold, interval, number, plain, prefix, quantity
from vispeg.report.record import Record, label, params_of, rows
from vispeg.report.sections.parameters import AT_BOUND, bounds_of, remark

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLE = "Verdict"


def context(record: Record) -> dict[str, Any]:
    """Verdict, sentence on the error, key figures, ladder picture and table, effects found."""
    values = record.values
    first, last, unit = words.ladder_ends(values)
    floor = record.mapping("noise_floor")
    figures = [(words.error_name(values), quantity(last, unit), words.against_floor(last, record.floor))]
    if len(record.rows("ladder")) > 1:
        figures.insert(0, ("Before", quantity(first, unit), "held-out error"))
        figures[1] = ("After", figures[1][1], words.against_floor(last, record.floor) or "held-out error")
    if record.floor is not None:
        figures.append(("Noise floor", quantity(record.floor, str(floor.get("unit") or unit)), _source(floor)))
    return {
        "verdict": values.get("verdict") if record.kind == "diagnosis" else None,
        "sentence": words.verdict(values),
        "fall": words.fall(values),
        "figures": figures,
        "picture": ladder_picture(record),
        "ladder": ladder_rows(record),
        "fitted": any(number(row.get("fit_error")) is not None for row in record.rows("ladder")),
        "reason": str(values.get("reason") or "").rstrip("."),
        "judged": "Recordings" if record.kind == "compare" else "Held-out recordings",
        "effects": effect_rows(record),
        "partial": effect_rows(record, "partial"),
        "floor_unit_differs": bool(floor.get("unit")) and floor.get("unit") != unit and bool(unit),
    }


def ladder_rows(record: Record) -> list[dict[str, str]]:
    """The ladder as text, errors in the unit of the table's largest."""
    ladder = record.rows("ladder")
    found = []
    for i, row in enumerate(ladder):
        unit = str(row.get("unit") or "")
        held = row.get("heldout_error")
        found.append(
            {
                "model": str(row.get("model", "?")),
                "fit": quantity(row.get("fit_error"), unit),
                "heldout": quantity(held, unit),
                "step": words.change(ladder[i - 1].get("heldout_error"), held) if i else "",
                "floor": words.against_floor(held, record.floor).removesuffix(" the noise floor"),
            }
        )
    return found


def effect_rows(record: Record, key: str = "effects") -> list[dict[str, str]]:
    """The effects under `key`, one row a parameter: those found, or (`partial`) those that do not suffice."""
    found = []
    for effect in record.rows(key):
        params = params_of(effect)
        others = ", ".join(label(other) for other in rows(effect, "indistinguishable_from"))
        for name, p in params.items():
            value, between = interval(p.get("value"), p.get("low"), p.get("high"))
            row = {"effect": label(effect), "param": name, "value": value, "interval": between}
            bound = at_bound(str(effect.get("effect")), name, p.get("value"))
            found.append({**row, "unit": str(p.get("unit") or ""), "rivals": others, "bound": bound})
        if not params:
            found.append(
                dict.fromkeys(("param", "value", "interval", "unit", "bound"), "")
                | {"effect": label(effect), "rivals": others}
            )
    return found


def at_bound(effect: str, param: str, value: Any) -> str:
    """`at its bound` where a value is as small or large as the effect allows; empty elsewhere, and at null."""
    known, x = bounds_of(effect, param), number(value)
    if known is None or x is None:
        return ""
    return "at its bound" if AT_BOUND in remark(x, x, x, known) else ""


def ladder_picture(record: Record) -> str:
    """The ladder as inline SVG; empty without numbers."""
    figure = ladder_figure(record)
    if figure is None:
        return ""
    with styled():
        return svg(figure, "ladder", words.fall(record.values))


def ladder_figure(record: Record) -> Figure | None:
    """Bars of held-out error on a log scale, one a model, with the noise floor as a line; None without numbers."""
    ladder = [(str(row.get("model", "?")), number(row.get("heldout_error")), row) for row in record.rows("ladder")]
    positive = [held for _, held, _ in ladder if held is not None and held > 0]
    if not positive:
        return None
    floor = record.floor if record.floor is not None and record.floor > 0 else None
    unit = str(ladder[0][2].get("unit") or "")
    factor, shown = prefix(max(positive), unit)
    fits = [number(row.get("fit_error")) for _, _, row in ladder]
    seen = positive + ([floor] if floor else []) + [f for f in fits if f is not None and f > 0]
    left, right = factor * min(min(seen) / 1.8, max(seen) / 12), factor * max(seen)
    right *= max(1.6, (right / left) ** 0.22)
    from matplotlib.ticker import LogLocator, NullLocator

    with styled():
        figure = new_figure(0.95 + 0.36 * len(ladder))
        ax = figure.add_subplot()
        for i, (_, held, _) in enumerate(ladder):
            if held is not None:
                colour = BEFORE if i == 0 else AFTER
                alpha = 1.0 if i in (0, len(ladder) - 1) else 0.55
                ax.barh(i, max(0.0, factor * held - left), left=left, height=0.62, color=colour, alpha=alpha)
            text = "not known" if held is None else _label(held * factor, shown, ladder[0][1] if i else None, held)
            end = max([left] + [factor * e for e in (held, fits[i]) if e is not None])
            ax.annotate(text, (end, i), (6, 0), textcoords="offset points", va="center", fontweight="bold")
            if (fit := fits[i]) is not None and fit > 0:
                ax.plot(factor * fit, i, marker="|", markersize=13, markeredgewidth=1.6, color=MEASURED)
        ax.set_xscale("log")
        ax.set(
            xlim=(left, right),
            ylim=(len(ladder) - 0.4, -0.6),
            xlabel=f"{words.error_name(record.values).lower()} ({shown}), log scale",
        )
        ax.set_yticks(range(len(ladder)), [_shorten(name) for name, _, _ in ladder])
        ax.tick_params(axis="y", labelcolor=MEASURED, labelsize=8.5)
        ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if right / left < 3e3 else (1.0,)))
        ax.xaxis.set_minor_locator(NullLocator())
        ax.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
        quiet(ax, grid="x")
        ax.spines["left"].set_visible(False)
        entries = {}
        if floor:
            ax.axvline(factor * floor, color=MUTED, linestyle=(0, (4, 2)), linewidth=1.3)
            entries["noise floor"] = (MUTED, "--")
        if any(f is not None and f > 0 for f in fits):
            entries["error on the fitted recordings"] = (MEASURED, "|")
        if entries:
            legend(figure, entries)
        return figure


def _label(value: float, unit: str, first: float | None, held: float) -> str:
    gain = ""
    if first and held > 0 and first / held >= 1.05:
        gain = f"  (÷ {first / held:.2f})" if first / held < 2 else f"  (÷ {fold(first / held)})"
    return f"{plain(value)} {unit.split(' RMS')[0]}{gain}"


def _shorten(name: str, most: int = 44) -> str:
    return name if len(name) <= most else f"{name[: most - 1]}…"


def _source(floor: dict[str, Any]) -> str:
    source = floor.get("from")
    return {"repeats": "from repeats", "stated noise": "from stated noise"}.get(str(source), str(source or ""))
