"""Make pages on success from sections, which are named by their templates in templates/gap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vispeg.report import page as shared
from vispeg.report.gap import bars
from vispeg.report.live import episodes

SCRIPTS = {"headline": bars.SCRIPTS, "episodes": episodes.SCRIPTS}  # template -> scripts that make it interactive


def page(title: str, kind: str, sections: Sequence[tuple[str, str, Mapping[str, Any]]]) -> str:
    """Return the page as HTML.

    Args:
        title: title of the document.
        kind: kind of page, shown beside the program's name.
        sections: (template's name in templates/gap, heading, the template's values), in order; the first heading is
            not shown.
    """
    made = [
        shared.Section(f"{t}-{i}", heading, f"gap/{t}", values, SCRIPTS.get(t, ()))
        for i, (t, heading, values) in enumerate(sections)
    ]
    return shared.page(title, kind, made)
