"""`vispeg suite compare`: compare versions of a policy, oldest first."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vispeg.api.playing import stamped
from vispeg.api.result import Result
from vispeg.core.files import write_text_atomic
from vispeg.core.paths import expanded
from vispeg.core.several import several
from vispeg.evaluation import suite as suites
from vispeg.evaluation.folder import workplace
from vispeg.evaluation.records import read
from vispeg.evaluation.schema.suite import VersionChange
from vispeg.evaluation.suite_file import read_result
from vispeg.report.gap import words
from vispeg.report.gap.suite_page import render
from vispeg.report.text.summary import Block, Line

FORMAT = "vispeg-suite-compare/1"


@dataclass(frozen=True, repr=False)
class VersionsResult(Result):
    """The health of every version, and changes from the last but one to the last version.

    Attributes:
        record: content of compare.json, see docs/reference/keys.md.
        sources: folders of the versions.
    """

    record: Mapping[str, Any]
    sources: tuple[str | Path, ...] = ()
    holds = "compare"  # class attribute, see `Result`

    @property
    def alarm(self) -> bool:
        """Whether the last version's health is an alarm, or success fell significantly."""
        fell = any(c["verdict"] == "fell" for c in self.record["changes"])
        return fell or self.record["versions"][-1]["health"]["status"] == "alarm"

    @property
    def summary(self) -> list[Block]:
        """One line per version, notes on their worlds, and one line per change."""
        versions, changes = self.record["versions"], self.record["changes"]
        lines = [*(f"{v['version']}: {v['health']['words']}" for v in versions), *self.record["notes"]]
        lines += [_line(c) for c in changes if c["verdict"] in ("fell", "rose")]
        if len(versions) > 1 and not any(c["verdict"] == "fell" for c in changes):
            lines.append("no regression beyond doubt")
        return [Line(text, path=True) for text in lines]

    def save(self, out: str | Path, *, overwrite: bool = False) -> Path:
        """Write compare.json and suite.html into a folder; see `Result.save`."""
        with workplace(out, "compare.json", overwrite, self.sources) as place:
            self._write(place)
        return expanded(out)

    def _write(self, folder: Path) -> None:
        values = stamped(self.record, 0, [Path(p) for p in self.sources])
        text = json.dumps(values, indent=1, allow_nan=False) + "\n"
        write_text_atomic(folder / "compare.json", text, overwrite=True)
        page = render(self.record["versions"], self.record["changes"], self.record["notes"])
        write_text_atomic(folder / "suite.html", page, overwrite=True)


def compare_versions(folders: str | Path | Sequence[str | Path]) -> VersionsResult:
    """Compare folders that `suite` wrote, oldest first.

    Args:
        folders: folders that `vispeg suite run` wrote.

    Raises:
        UserError: a folder without a result, or versions in different worlds or with nothing in common.
    """
    places = [Path(folder) for folder in several(folders)]
    versions = [read_result(folder) for folder in places]
    notes = suites.other_worlds(versions)
    changes: list[VersionChange] = []
    if len(versions) > 1:
        before, after = (read(folder / "episodes.jsonl") for folder in places[-2:])
        changes = suites.regressions(before, after)
    record = {"format": FORMAT, "versions": versions, "changes": changes, "notes": notes}
    return VersionsResult(record, tuple(places))


def _line(change: VersionChange) -> str:
    where = f"{change['policy']} in {change['world']}, {change['configuration']}"
    return f"{change['verdict']}: {where}: {words.signed(change['change'])} points"
