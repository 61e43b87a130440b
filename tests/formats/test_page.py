"""Keys are explained once: of files that a user writes in docs/formats.md, of results by the types in the code."""

import re
from dataclasses import fields
from importlib import import_module
from inspect import getdoc
from pathlib import Path

import pytest

from vispeg.diagnosis.schema import ComparisonRecord, DiagnosisRecord, FoundEffect, Summary
from vispeg.interface.interface import Interface
from vispeg.recordings.objects import Header as ObjectHeader
from vispeg.report.fitted import FitRecord
from vispeg.trials.trial import Said
from vispeg.worlds.measurement_file import MEASUREMENT, BudgetRow, Quantity
from vispeg.worlds.model_file import ENTRY, MODEL

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
KEYS = (ROOT / "docs" / "reference" / "keys.md").read_text(encoding="utf-8")


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
        ("Trials: `vispeg-trial/1`", {"format", *Said.model_fields}),
        ("Measurements: `vispeg-measurement/1`", {"format", *MEASUREMENT.keys}),
    ],
)
def test_a_table_names_every_key_and_no_other(heading, schema):
    named = keys(heading)
    assert sorted(named) == sorted(schema)


def explained(kind: type) -> list[str]:
    """The keys in the section `Attributes:` of a type's own docstring, in order."""
    own = (getdoc(kind) or "").split("Attributes:\n")[1].split("\n\n")[0]
    return [key for line in re.findall(r"^    (\w[\w, ]*):", own, re.MULTILINE) for key in line.split(", ")]


@pytest.mark.parametrize("kind", [Summary, FitRecord, Interface], ids=lambda kind: kind.__name__)
def test_a_type_explains_every_key_and_no_other(kind):
    assert sorted(explained(kind)) == sorted(kind.__annotations__)


def test_every_key_of_a_diagnosis_and_a_comparison_is_explained_once():
    diagnosis, comparison = [*explained(Summary), *explained(DiagnosisRecord)], explained(ComparisonRecord)
    assert sorted(diagnosis) == sorted(DiagnosisRecord.__annotations__)
    assert {*comparison} <= {*ComparisonRecord.__annotations__} <= {*comparison, *diagnosis}
    assert {*comparison} & {*diagnosis} == {"format"}
    assert {*explained(FoundEffect)} | {"effect", "where"} == {*FoundEffect.__annotations__}


def test_parts_are_named():
    def words(heading):
        return set(re.findall(r"[a-z_0-9]+", section(heading)))

    assert {f.name for kind in (Quantity, BudgetRow) for f in fields(kind)} <= words(
        "Measurements: `vispeg-measurement/1`"
    )
    assert {*ENTRY, *MODEL.keys} <= words("A model file")
    assert {*ObjectHeader.model_fields} <= words("Objects in free motion: `vispeg-object-recording/1`")
    trial = words("Trials: `vispeg-trial/1`")
    for name in ("policy", "world", "start", "outcome", "timing", "how"):
        part = Said.model_fields[name].annotation
        assert part is not None and set(part.model_fields) <= trial, name


def test_the_page_of_keys_shows_types_that_are_there():
    shown = re.findall(r"^::: (.*)$", KEYS, re.MULTILINE)
    assert shown
    for name in shown:
        module, _, kind = name.rpartition(".")
        assert hasattr(import_module(module), kind) if kind[0].isupper() else import_module(name), name
