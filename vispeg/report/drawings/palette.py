"""The colours of pages for light and dark mode. Figures use the light colours.

`themed` replaces them in a drawing by CSS variables, `var(--name)`, so that the browser chooses; `css` defines these.
"""

from __future__ import annotations

import re

COLOURS: dict[str, tuple[str, str]] = {  # name -> (light mode, dark mode); the light colours are all different
    "ground": ("#ffffff", "#15171b"),
    "ink": ("#16181d", "#e6e8eb"),
    "muted": ("#626975", "#a2aab5"),
    "rule": ("#d7dbe0", "#3b4049"),
    "soft": ("#f4f5f6", "#202329"),
    "empty": ("#e2e5e9", "#2b2f36"),
    "before": ("#d9541e", "#ff8f5c"),
    "after": ("#0a7a75", "#42c0b7"),
    "rival": ("#5b4bb7", "#a99df6"),
    "other": ("#b0892b", "#ddb65c"),
    "amber": ("#a16207", "#dfa437"),
    "red": ("#b3261e", "#f2766c"),
    # policies by modality: the colours of the pictures in README
    "state": ("#555555", "#bcc0c7"),
    "depth": ("#1f6fb4", "#62aeee"),
    "rgbd": ("#2a9d60", "#58ca8e"),
    "rgb": ("#d9822b", "#f0a95f"),
    "blind": ("#b0b0b0", "#7c818a"),
    # further policies, and failure categories
    "plum": ("#a2456b", "#e08cae"),
    "olive": ("#5d7d2a", "#a5c76d"),
    "brown": ("#7a5230", "#c99f7c"),
    "lagoon": ("#3b8ea5", "#7cc6da"),
    "violet": ("#8e6bbf", "#bd9fe6"),
    "pale": ("#c9ced6", "#565d68"),
    "sand": ("#e3b04b", "#e3b04d"),
    "wine": ("#7a1f1f", "#d9716f"),
    "slate": ("#8a8f98", "#8a8f99"),
}
_NAMES = {day: name for name, (day, _) in COLOURS.items()}
_HEX = re.compile(r"#[0-9a-f]{6}\b")


def day(name: str) -> str:
    """Return a colour for light mode, `#rrggbb`."""
    return COLOURS[name][0]


def name_of(colour: str) -> str:
    """Return the name of a light-mode colour `#rrggbb`."""
    return _NAMES[colour]


def themed(text: str) -> str:
    """Replace every named colour in a drawing by its CSS variable; other colours stay."""
    return _HEX.sub(lambda match: f"var(--{_NAMES[match[0]]})" if match[0] in _NAMES else match[0], text)


def css() -> str:
    """Return the definitions of the CSS variables; dark mode applies only on screens, not in print."""
    sides = ["".join(f"--{name}:{pair[i]};" for name, pair in COLOURS.items()) for i in (0, 1)]
    return (
        f":root{{color-scheme:light dark;{sides[0]}}}\n"
        f"@media screen and (prefers-color-scheme:dark){{:root{{{sides[1]}}}}}"
    )
