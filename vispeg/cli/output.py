"""The options `--json` and `--quiet` of every command: the form of its result, and whether it shows progress."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from vispeg.report.text.summary import Block

SWITCH = tyro.conf.arg(help_behavior_hint="")  # no default in the help text


@dataclass(frozen=True)
class Output:
    """Output."""

    json: Annotated[bool, SWITCH] = False
    """Print one JSON object in place of text."""
    quiet: Annotated[bool, SWITCH] = False
    """Show no progress and no notes."""

    def give(self, record: Mapping[str, object], text: Iterable[str | Block]) -> None:
        """Print the record as JSON, or the lines and tables for a person."""
        if self.json:
            print(json.dumps(record, indent=1, allow_nan=False, default=str))
            return
        from vispeg.report.text.summary import Line, print_summary

        print_summary(Line(block, path=True) if isinstance(block, str) else block for block in text)

    def line(self, text: str) -> None:
        """Print one line of a result that arrives in pieces; nothing with --json, because the record has it."""
        if not self.json:
            print(text, flush=True)


OutputOptions = Annotated[Output, tyro.conf.arg(name="")]
