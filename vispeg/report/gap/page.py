"""Pages on success: sections named by their templates in templates/gap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vispeg.report import page as shared
from vispeg.report.gap import bars
from vispeg.report.live import episodes

SCRIPTS = {"headline": bars.SCRIPTS, "episodes": episodes.SCRIPTS}  # template -> what answers the mouse in it


def page(title: str, kind: str, sections: Sequence[tuple[str, str, Mapping[str, Any]]]) -> str:
    """Give the whole page as text.

    Args:
        title: of the document.
        kind: stands beside the brand.
        sections: (template's name in templates/gap, heading, what the template shows), in order; the first has no
            heading.
    """
    made = [
        shared.Section(f"{t}-{i}", heading, f"gap/{t}", values, SCRIPTS.get(t, ()))
        for i, (t, heading, values) in enumerate(sections)
    ]
    return shared.page(title, kind, made)
