"""The library of effects as text: a list of all effects, or one in full."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypedDict, get_args

from vispeg.core.effect import Effect, Family
from vispeg.core.params import Param
from vispeg.report.text.effect_words import file_text, summary, unit
from vispeg.report.text.tables import Column, Sheet, terminal, wrapped

WIDEST = 100  # most columns of text, even on a wider terminal
GROUPS = get_args(Family)
GROUP_WORDS = {
    "joint": "friction, springs and play in a joint",
    "drive": "between a command and the torque at the joint",
    "sensor": "encoders and the wrist's wrench sensor",
    "body": "masses, gravity, orientation of the base",
    "contact": "friction, stiffness, damping and compliance in contact",
    "task": "held part, grip and goal: true and believed poses",
    "camera": "lens, image sensor, depth, timing and codec",
    "appearance": "colours, textures, lamps and surroundings",
}


def places(kind: Effect, robot: Any) -> str:
    """Return the places of an effect in short: `joint1 ... joint7, all`; at `all` they share one value.

    `robot`, here and below, is the arm or the cell whose joints, links or parts are the places.
    """
    targets = kind.targets(robot)
    if len(targets) == 1:
        return targets[0]
    return f"{targets[0]} ... {targets[-1]}, all" if len(targets) > 2 else ", ".join([*targets, "all"])


class ParamEntry(TypedDict):
    """A parameter of an effect; `null` is None for a shape parameter, which has no null value."""

    unit: str
    low: float
    high: float
    null: float | None
    typical: float
    doc: str


class EffectEntry(TypedDict):
    """An effect in the catalogue."""

    name: str
    family: str
    summary: str
    description: str
    where: list[str]
    params: dict[str, ParamEntry]


def describe(kind: Effect, robot: Any) -> EffectEntry:
    """Return an effect's entry for JSON."""
    params: dict[str, ParamEntry] = {}
    for name, p in kind.params.items():
        null = None if p.shape else p.null
        params[name] = {"unit": p.unit, "low": p.low, "high": p.high, "null": null, "typical": p.start, "doc": p.doc}
    return {
        "name": kind.name,
        "family": kind.family,
        "summary": summary(kind),
        "description": file_text(kind),
        "where": kind.targets(robot),
        "params": params,
    }


def print_catalogue(kinds: Sequence[Effect], models: Sequence[Any]) -> None:
    """Print effects by family, each with summary, places, and `bounds` of its parameters.

    `models` has one arm or cell per effect: that on which its places are.
    """
    from rich.text import Text

    console = terminal()
    width = min(console.width, WIDEST)
    groups: dict[str, list[tuple[Effect, Any]]] = {}
    for kind, robot in zip(kinds, models, strict=True):
        groups.setdefault(kind.family, []).append((kind, robot))
    text = Text(no_wrap=True, overflow="ignore")
    for group in sorted(groups, key=GROUPS.index):
        text.append(f"# {group}: {GROUP_WORDS[group]}\n", style="bold")
        for kind, robot in groups[group]:
            text.append(f"\n{kind.name}", style="bold").append(f"  {places(kind, robot)}\n", style="dim")
            text.append(f"{_block(summary(kind), width, 2)}\n")
            for name, p in kind.params.items():
                text.append(f"{_block(f'{name}: {bounds(p)}', width, 4)}\n")
        text.append("\n")
    text.right_crop(2)  # the empty line after the last group, and the end of line that `print` adds
    console.print(text)


def print_effect(kind: Effect, robot: Any) -> None:
    """Print one effect in full: summary, equation, places and parameters."""
    from rich.text import Text

    console = terminal()
    console.print(Text(kind.name, style="bold").append(f"  {summary(kind)}", style="not bold"))
    for paragraph in file_text(kind).split("\n\n"):
        lines = paragraph.splitlines()
        flowing = not any(line.startswith(" ") for line in lines)  # indented lines keep their breaks
        console.print(Text("\n" + (" ".join(lines) if flowing else paragraph)), width=min(console.width, WIDEST))
    console.print()
    console.print(Text(f"where: {places(kind, robot)}"))
    heads = ("From", "To", "Null", "Typical")
    columns = [Column("Parameter"), Column("Unit"), *(Column(head, right=True) for head in heads)]
    rows = [
        [
            name,
            unit(p.unit) or "-",
            f"{p.low:g}",
            f"{p.high:g}",
            "shape" if p.shape else f"{p.null:g}",
            f"{p.start:g}",
            p.doc,
        ]
        for name, p in kind.params.items()
    ]
    console.print(Sheet([*columns, Column("What it is", prose=True)], rows))


def bounds(p: Param) -> str:
    """Return a parameter's bounds, null value and meaning: `0 to 30 N m, null 0: dry friction torque`.

    A shape parameter, which has no null value, has `shape` instead.
    """
    null = "shape" if p.shape else f"null {p.null:g}"
    return f"{p.low:g} to {p.high:g} {unit(p.unit)}".rstrip() + f", {null}" + (f": {p.doc}" if p.doc else "")


def _block(text: str, width: int, indent: int) -> str:
    """Return text wrapped to `width` columns, each line indented by `indent`."""
    return "\n".join(" " * indent + line for line in wrapped(text, width - indent))
