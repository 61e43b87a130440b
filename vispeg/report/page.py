"""Make a self-contained HTML page from sections, for every report, without external links or requests."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from vispeg import __version__
from vispeg.report.drawings.palette import css

if TYPE_CHECKING:
    from jinja2 import Environment

LITERAL = "script|style|svg|pre|code|textarea"  # elements whose text stays as it is
TEXT = re.compile(rf"<({LITERAL})\b.*?</\1>|>[^<]+", re.DOTALL)
UNIT = r"[mµk]?(?:rad|N|m|s|g|Hz|px|A|J|W|Pa)[²³]?(?:/(?:rad|kg|m|s)[²³]?)*"
QUANTITY = re.compile(rf"(?<=\d)(?: (?:{UNIT}|RMS|%|[×÷]|min|h))+(?!\w)")
NO_BREAK = "\N{NO-BREAK SPACE}"


@dataclass(frozen=True)
class Section:
    """A part of a page.

    Attributes:
        name: anchor of the section.
        title: heading.
        template: the file templates/TEMPLATE.html.j2.
        values: values for the template.
        scripts, styles: files of templates/ that the section needs; a page includes each once.
    """

    name: str
    title: str
    template: str
    values: Mapping[str, Any]
    scripts: tuple[str, ...] = ()
    styles: tuple[str, ...] = ()


def page(title: str, kind: str, sections: Sequence[Section]) -> str:
    """Return the page as HTML.

    Args:
        title: title of the document.
        kind: kind of page, shown beside the program's name.
        sections: the sections, in order; the first has no heading.
    """
    from markupsafe import Markup

    made = []
    for section in sections:
        html = templates().get_template(f"{section.template}.html.j2").render(section.values)
        made.append({"name": section.name, "title": section.title, "html": Markup(unbroken(html))})
    scripts = [Markup(source(name)) for name in dict.fromkeys(n for s in sections for n in s.scripts)]
    styles = [Markup(source(name)) for name in dict.fromkeys(n for s in sections for n in s.styles)]
    values = {"sections": made, "title": title, "kind": kind, "version": __version__, "palette": Markup(css())}
    values |= {"scripts": scripts, "styles": styles}
    return templates().get_template("report.html.j2").render(values) + "\n"


def unbroken(html: str) -> str:
    """Return HTML in whose text no line ends between a number and its unit, as in `30.2 mrad RMS` and `7.1 ×`."""

    def joined(text: re.Match[str]) -> str:
        return text[0] if text[1] else QUANTITY.sub(lambda unit: unit[0].replace(" ", NO_BREAK), text[0])

    return TEXT.sub(joined, html)


@cache
def source(name: str) -> str:
    """Return the text of a file of templates/."""
    return (files("vispeg.report") / "templates" / name).read_text(encoding="utf-8")


@cache
def templates(package: str = "vispeg.report") -> Environment:
    """Return the templates of a package; values are escaped unless they are Markup, and a missing value is an error."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup, escape

    environment = Environment(
        loader=PackageLoader(package, "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["breakable"] = lambda name: escape(name).replace("(", Markup("<wbr>("))
    return environment
