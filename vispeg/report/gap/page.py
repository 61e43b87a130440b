"""One self-contained HTML page from sections: no script, no link that leaves it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vispeg import __version__


def page(title: str, kind: str, sections: Sequence[tuple[str, str, Mapping[str, Any]]]) -> str:
    """The whole page as text.

    Args:
        title: of the document.
        kind: stands beside the brand.
        sections: (template's name in templates/gap, heading, what the template shows), in order; the first has no
            heading.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    pages = Environment(
        loader=PackageLoader("vispeg.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made = []
    for name, heading, values in sections:
        html = pages.get_template(f"gap/{name}.html.j2").render(values)
        made.append({"name": f"{name}-{len(made)}", "title": heading, "html": Markup(html)})
    return (
        pages.get_template("report.html.j2").render(sections=made, title=title, kind=kind, version=__version__) + "\n"
    )
