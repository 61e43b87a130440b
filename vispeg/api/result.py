"""The base class of results, which can be printed, plotted, tabulated and saved."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.core.paths import expanded
from vispeg.report.text.summary import Summarised, print_summary
from vispeg.report.text.tables import PIPED, Sheet

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from vispeg.diagnosis.traces import Trace

LONGEST = 150  # characters of the first block of a summary that `repr` shows


class Traced:
    """A result that holds measured and predicted values over time, in `arrays`."""

    arrays: Mapping[str, np.ndarray]

    @property
    def traces(self) -> tuple[Trace, ...]:
        """Measured and predicted values of each recorded stretch, in each channel."""
        from vispeg.report.evidence import evidence_of

        return evidence_of(self.arrays).every


class Result(Summarised):
    """A result with a summary; a notebook shows it as tables, `print` as text.

    Attributes:
        holds: the kind of folder that `save` writes, see `vispeg.core.marker`; set by each class of results.
        tables: keys of `record` that hold a table; `to_pandas` returns the first of them that is not empty.
        sources: files and folders that were read, which `save` never replaces.
    """

    holds: ClassVar[str]
    tables: ClassVar[tuple[str, ...]] = ()
    sources: tuple[str | Path, ...] = ()

    @abstractmethod
    def _write(self, folder: Path) -> None:
        """Write everything into an empty folder."""

    def save(self, out: str | Path, *, overwrite: bool = False) -> Path:
        """Write the folder that the command of the same name writes; return its path.

        Raises:
            UserError: `out` holds other files, exists while `overwrite` is False, or cannot be written.
        """
        with new_folder(out, overwrite=overwrite, holds=self.holds, inputs=self.sources) as folder:
            self._write(folder)
        return expanded(out)

    def plot(self) -> Figure:
        """Return the main picture of the result's page as a matplotlib figure.

        Raises:
            UserError: the result has no single picture; see the page that `save` writes.
        """
        raise UserError("this result has no single picture", expected="the page that save(folder) writes")

    def to_pandas(self) -> DataFrame:
        """Return the main table of `record` as a pandas.DataFrame, one row per entry; nested keys are joined by dots.

        Raises:
            UserError: pandas is not installed, or this result has no table.
        """
        try:
            import pandas
        except ImportError as error:
            raise UserError("a table needs pandas", expected="pip install pandas") from error
        record = cast("Mapping[str, Any]", getattr(self, "record", {}))
        name = next((name for name in self.tables if record.get(name)), None)
        if name is None:
            raise UserError("this result has no table", got=type(self).__name__)
        return pandas.json_normalize([*record[name]])

    def __repr__(self) -> str:
        first = next(iter(self.summary), None)
        if isinstance(first, Sheet):
            text = "; ".join(" ".join(filter(None, (str(cell).strip() for cell in row))) for row in first.rows)
        else:
            text = "" if first is None else first.text
        return f"<{type(self).__name__}: {text if len(text) <= LONGEST else f'{text[:LONGEST]} ...'}>"

    def __str__(self) -> str:
        from rich.console import Console

        # Plain text everywhere: in a notebook, rich would add an empty output and colour the text.
        plain = StringIO()
        console = Console(file=plain, highlight=False, width=PIPED, color_system=None, force_jupyter=False)
        print_summary(self.summary, console)
        return plain.getvalue().rstrip("\n")
