"""Builds the one self-contained HTML file of a finished diagnosis or comparison."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from vispeg import __version__
from vispeg.core.files import write_text_atomic
from vispeg.report.record import Record, load_record
from vispeg.report.sections import COMPARE, DIAGNOSIS


def write_report(out: Path, *, overwrite: bool = False) -> Path:
    """Reads OUT/diagnosis.json (or OUT/compare.json) and OUT/evidence.npz, writes OUT/report.html; returns its path.

    Raises:
        UserError: no record in `out`, a file that cannot be read, or a report there already while `overwrite` is False.
    """
    return write_text_atomic(Path(out) / "report.html", render(load_record(Path(out))), overwrite=overwrite)


def render(record: Record) -> str:
    """The whole page as text: no script, no link that leaves it."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup, escape

    pages = Environment(
        loader=PackageLoader("vispeg.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    pages.filters["breakable"] = lambda name: escape(name).replace("(", Markup("<wbr>("))
    sections = []
    for name in DIAGNOSIS if record.kind == "diagnosis" else COMPARE:
        module = import_module(f"vispeg.report.sections.{name}")
        values = module.context(record)
        if values is None:  # nothing to show
            continue
        html = pages.get_template(f"sections/{name}.html.j2").render(values)
        sections.append({"name": name, "title": module.TITLE, "html": Markup(html)})
    kind = "diagnosis" if record.kind == "diagnosis" else "comparison"
    verdict = record.values.get("verdict") if record.kind == "diagnosis" else None
    title = f"vispeg {kind}" + (f": {verdict}" if verdict else "")
    page = pages.get_template("report.html.j2")
    return page.render(sections=sections, title=title, kind=kind, version=__version__) + "\n"
