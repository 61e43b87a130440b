"""The ladder of models: the held-out error as effects are added, as table rows and as a bar chart."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from vispeg.report.drawings.figures import (
    AFTER,
    BEFORE,
    GROUND,
    MEASURED,
    MUTED,
    WIDE,
    Shape,
    legend,
    new_figure,
    quiet,
)
from vispeg.report.record import Record
from vispeg.report.text import effect_words, words
from vispeg.report.text.quantities import fold, number, plain, prefix, quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ADDED = re.compile(r"\+ (\w+)\(([\w-]+)\)")
LONGEST = 44  # most characters of a model's name in the figure


def ladder_rows(record: Record) -> list[dict[str, str]]:
    """Return the ladder as text: errors, change from the previous model, multiples of the noise floor."""
    ladder = record.rows("ladder")
    lines = []
    for i, row in enumerate(ladder):
        unit = str(row.get("unit") or "")
        held = row.get("heldout_error")
        lines.append(
            {
                "model": str(row.get("model", "?")),
                "words": model_words(row),
                "fit": quantity(row.get("fit_error"), unit),
                "heldout": quantity(held, unit),
                "step": words.change(ladder[i - 1].get("heldout_error"), held) if i else "",
                "floor": words.against_floor(held, record.floor).removesuffix(" the noise floor"),
            }
        )
    return lines


def model_words(row: Mapping[str, Any]) -> str:
    """Return a model's name in words: `+ Coulomb friction in joint 4` for `+ coulomb_friction(joint4)`."""
    name = str(row.get("model", "?"))
    added = ADDED.fullmatch(name)
    return f"+ {effect_words.named({'effect': added[1], 'where': added[2]})}" if added else name


def ladder_figure(record: Record, shape: Shape = WIDE) -> Figure | None:
    """Draw the held-out error of each model as a bar on a log scale, with the noise floor; None without numbers."""
    ladder = [(model_words(row), number(row.get("heldout_error")), row) for row in record.rows("ladder")]
    positive = [held for _, held, _ in ladder if held is not None and held > 0]
    if not positive:
        return None
    floor = record.floor if record.floor is not None and record.floor > 0 else None
    unit = str(ladder[0][2].get("unit") or "")
    factor, scaled_unit = prefix(max(positive), unit)
    fits = [number(row.get("fit_error")) for _, _, row in ladder]
    values = positive + ([floor] if floor else []) + [f for f in fits if f is not None and f > 0]
    left, right = factor * min(min(values) / 1.8, max(values) / 12), factor * max(values)
    right *= max(1.6, (right / left) ** (0.7 if shape.narrow else 0.3))  # room for the label beside a bar
    clear: Any = {"facecolor": GROUND, "edgecolor": "none", "pad": 0.5}  # behind text that the noise floor would cross
    figure = new_figure((1.1 if shape.narrow else 0.95) + (0.62 if shape.narrow else 0.44) * len(ladder), shape.width)
    ax = figure.add_subplot()
    for i, (name, held, _) in enumerate(ladder):
        if held is not None:
            colour = BEFORE if i == 0 else AFTER
            alpha = 1.0 if i in (0, len(ladder) - 1) else 0.55
            ax.barh(i, max(0.0, factor * held - left), left=left, height=0.5, color=colour, alpha=alpha)
        text = "not known" if held is None else _label(held * factor, scaled_unit, ladder[0][1] if i else None, held)
        end = left if held is None else max(left, factor * held)
        ax.annotate(text, (end, i), (6, 0), textcoords="offset points", va="center", fontweight="bold", bbox=clear)
        if (fit := fits[i]) is not None and fit > 0:  # the mark is below the bar, not between the bar and its label
            ax.plot(factor * fit, i + 0.36, marker="^", markersize=5, color=MEASURED, clip_on=False)
        if shape.narrow:
            ax.annotate(_shorten(name), (left, i - 0.27), (0, 1), textcoords="offset points", va="bottom", bbox=clear)
    _log_axis(ax, left, right)
    ax.set_xlabel(f"{words.error_name(record.values).lower()} ({scaled_unit}), log scale")
    ax.set_ylim(len(ladder) - 0.4, -0.75 if shape.narrow else -0.5)
    ax.set_yticks(
        [] if shape.narrow else range(len(ladder)), [] if shape.narrow else [_shorten(n) for n, _, _ in ladder]
    )
    ax.tick_params(axis="y", labelcolor=MEASURED)
    entries = {}
    if floor:
        ax.axvline(factor * floor, color=MUTED, linestyle=(0, (4, 2)), linewidth=1.3)
        entries["noise floor"] = (MUTED, "--")
    if any(f is not None and f > 0 for f in fits):
        entries["error on the fitted recordings"] = (MEASURED, "^")
    if entries:
        legend(figure, entries)
    return figure


def _log_axis(ax: Axes, left: float, right: float) -> None:
    from matplotlib.ticker import LogLocator, NullLocator

    ax.set_xscale("log")
    ax.set_xlim(left, right)
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if right / left < 200 else (1.0,)))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_major_formatter(lambda x, _: f"{x:g}")
    quiet(ax, grid="x")
    ax.spines["left"].set_visible(False)


def _label(value: float, unit: str, first: float | None, held: float) -> str:
    """Return an error with its unit; if it is at least 5 % below the first model's, also their ratio: `(÷ 1.32)`.

    `value` is `held` in the scaled `unit`; `first` is the first model's error, None for that model itself.
    """
    gain = ""
    if first and held > 0 and first / held >= 1.05:
        gain = f" (÷ {first / held:.2f})" if first / held < 2 else f" (÷ {fold(first / held)})"
    return f"{plain(value)} {unit.split(' RMS')[0]}{gain}"


def _shorten(name: str) -> str:
    return name if len(name) <= LONGEST else f"{name[: LONGEST - 1]}…"
