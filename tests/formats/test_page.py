"""The tables of keys in docs/formats.md are those of the types in the code."""

import re
from dataclasses import fields
from pathlib import Path

import pytest

from vispeg.diagnosis.schema import ComparisonRecord, DiagnosisRecord, FoundEffect
from vispeg.interface.interface import Interface
from vispeg.recordings.objects import Header as ObjectHeader
from vispeg.report.fitted import FitRecord
from vispeg.trials.trial import Said
from vispeg.worlds.measurement_file import MEASUREMENT, BudgetRow, Quantity
from vispeg.worlds.model_file import ENTRY, MODEL

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")


def section(heading: str) -> str:
    """The text from a heading to the next one."""
    return PAGE.split(f"# {heading}\n", 1)[1].split("\n#", 1)[0]


def keys(heading: str) -> list[str]:
    """What the first column of a section's table of keys names, in order."""
    table = re.split(r"^\| key[^|]* \| meaning \|\n\|---\|---\|\n", section(heading), flags=re.MULTILINE)[1]
    rows = [line for line in table.split("\n\n")[0].splitlines() if line.startswith("| ")]
    return [key for row in rows for key in re.findall(r"`([a-z_0-9]+)`", row.split(" | ")[0])]


@pytest.mark.parametrize(
    ("heading", "schema"),
    [
        ("`diagnosis.json`", set(DiagnosisRecord.__annotations__)),
        ("`fit.json`", set(FitRecord.__annotations__)),
        ("Trials: `vispeg-trial/1`", {"format", *Said.model_fields}),
        ("Exported policies: `vispeg-interface/1`", set(Interface.model_fields)),
        ("Measurements: `vispeg-measurement/1`", {"format", *MEASUREMENT.keys}),
    ],
)
def test_a_table_names_every_key_and_no_other(heading, schema):
    named = keys(heading)
    assert sorted(named) == sorted(schema)


def test_the_rest_of_a_comparison_is_as_in_a_diagnosis():
    own = keys("`compare.json`")
    assert sorted({*own} | {*keys("`diagnosis.json`")} & {*ComparisonRecord.__annotations__}) == sorted(
        ComparisonRecord.__annotations__
    )
    assert not {*own} & {*keys("`diagnosis.json`")}


def test_parts_are_named():
    def words(heading):
        return set(re.findall(r"[a-z_0-9]+", section(heading)))

    assert {f.name for kind in (Quantity, BudgetRow) for f in fields(kind)} <= words(
        "Measurements: `vispeg-measurement/1`"
    )
    assert {*ENTRY, *MODEL.keys} <= words("A model file")
    assert {*FoundEffect.__annotations__} <= words("`diagnosis.json`") | words("A model file")
    assert {*ObjectHeader.model_fields} <= words("Objects in free motion: `vispeg-object-recording/1`")
    trial = words("Trials: `vispeg-trial/1`")
    for name in ("policy", "world", "start", "outcome", "timing", "how"):
        part = Said.model_fields[name].annotation
        assert part is not None and set(part.model_fields) <= trial, name


def test_the_types_that_the_page_points_to_are_there():
    named = re.findall(r"`(vispeg/[a-z_/]+\.py)`", section("Other results"))
    assert named and all((ROOT / name).is_file() for name in named)
