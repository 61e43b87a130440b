"""Read the `suite.json` of earlier versions, for `vispeg suite compare`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, cast

from pydantic import BaseModel, Field

from vispeg.evaluation.schema.suite import SuiteRecord
from vispeg.formats.format import Format, enrol
from vispeg.formats.guard import MB
from vispeg.formats.typed import typed

RESULT = Format("vispeg-suite-result/1", "a suite's result", language="json", most=64 * MB)


class _Rate(BaseModel):
    value: float
    low: float
    high: float


class _Correlation(BaseModel):
    value: float | None
    low: float | None
    high: float | None


class _Row(BaseModel):
    configuration: str
    policy: str
    train: _Rate
    target: _Rate


class _World(BaseModel):
    name: str
    hash: str


class _Health(BaseModel):
    status: str
    words: str
    pearson: _Correlation | None = None


class _Result(BaseModel):
    version: str
    train: str
    target: str
    rows: Annotated[list[_Row], Field(min_length=1)]
    health: _Health
    worlds: list[_World] | None = None
    notes: list[str] | None = None
    provenance: Mapping[str, object] | None = None


def _example(folder: Path) -> Path:
    import json

    from vispeg.evaluation.example import episodes
    from vispeg.evaluation.suite import summarise

    values = summarise(episodes(("S", "V"), ("a", "b")), "S", "V", "1")
    (folder / "suite.json").write_text(json.dumps(values), encoding="utf-8")
    return folder


@enrol(RESULT.name, _example)
def read_result(folder: Path) -> SuiteRecord:
    """Return the record in a folder that `vispeg suite run` wrote.

    Raises:
        UserError: no such file, another format, or an invalid value; the error names its key.
    """
    path = folder / "suite.json"
    values = RESULT.read(path)
    typed(_Result, values, path)
    return cast("SuiteRecord", {"format": RESULT.name, **values})
