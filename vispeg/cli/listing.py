"""Print a list of names, such as worlds or policies, as a table or as JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vispeg.cli.output import Output

if TYPE_CHECKING:
    from vispeg.api.library.catalogue import Entry


def show(
    what: str,
    entries: list[Entry],
    heading: str,
    family: str | None,
    text: str | None,
    output: Output,
    ending: str = "",
) -> int:
    """Print the matching entries, with the line `ending`; in JSON, under the key `what`.

    Raises:
        UserError: an unknown family.
    """
    from vispeg.api.library.catalogue import search
    from vispeg.core.errors import UserError
    from vispeg.report.text.summary import Block, Line
    from vispeg.report.text.tables import Column, Sheet

    families = sorted({entry.family for entry in entries})
    if family is not None and family not in families:
        raise UserError("unknown family", key="--family", got=family, choices=families)
    matching = search(entries, text or "", family)
    columns = [Column("name"), Column(heading), Column("what it is", prose=True)]
    rows = [[entry.name, entry.family, entry.about] for entry in matching]
    blocks: list[Block | str] = [Sheet(columns, rows) if rows else "none"]
    blocks += [Line(ending)] if ending else []
    output.give({what: [entry.record for entry in matching]}, blocks)
    return 0
