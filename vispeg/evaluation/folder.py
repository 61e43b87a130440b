"""The folder of an evaluation: new, one in which the same was stopped, or one whose result may be replaced."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from vispeg.core.disk import written
from vispeg.core.errors import UserError
from vispeg.core.lock import claimed
from vispeg.core.marker import apart, holds, mark, untouched
from vispeg.formats.json_data import read_json


@contextmanager
def workplace(
    out: str | Path | None, result: str, overwrite: bool = False, inputs: Iterable[str | Path | None] = ()
) -> Iterator[Path]:
    """Give the folder that `prepare` makes, kept from other processes while the body runs; a temporary one without
    `out`.
    """
    if out is None:
        with TemporaryDirectory(prefix="vispeg-") as folder:
            yield Path(folder)
        return
    out = Path(out).expanduser()
    refuse(out, result, inputs)
    with claimed(out):
        yield prepare(out, result, overwrite, inputs)


def refuse(out: Path, result: str, inputs: Iterable[str | Path | None] = ()) -> None:
    """Raise UserError where `out` is something else than a folder of such results, or is among the inputs."""
    kind = Path(result).stem
    apart(out, inputs)
    if out.is_file() or (out.is_dir() and not untouched(out) and _kind(out) not in (kind, "")):
        raise UserError("is not a folder of such results", file=out, expected="a new or empty folder, or one of a run")


def prepare(out: Path, result: str, overwrite: bool, inputs: Iterable[str | Path | None] = ()) -> Path:
    """Make the folder, or clear a finished result in it away.

    Args:
        out: where.
        result: name of the file that stands there once all is done.
        overwrite: whether a finished result is replaced.
        inputs: what is read; `out` may be none of it, nor a folder above.

    Raises:
        UserError: a finished result is there and `overwrite` is False, or files of something else are, or nothing can
            be written.
    """
    refuse(out, result, inputs)
    kind = Path(result).stem
    page = out / ("suite.html" if kind == "compare" else f"{kind}.html")
    done = (out / result).exists() and (page.exists() or holds(out) is None)  # the page comes last; once it had others
    if done and not overwrite:
        raise UserError("exists already; name another folder or pass --overwrite", file=out / result)
    if done:  # a new run, so nothing of the old one is continued
        for old in (page.name, result, "episodes.jsonl", "run.json"):
            with written(out / old):
                (out / old).unlink(missing_ok=True)
    with written(out):
        out.mkdir(parents=True, exist_ok=True)
        mark(out, kind, files=())
    return out


def _kind(out: Path) -> str | None:
    """Return the kind of run in a folder by its marker; "" if written by a version without markers, None if it holds no
    run.
    """
    if (marked := holds(out)) is not None:
        return marked
    try:
        run = read_json(out / "run.json")
    except UserError:
        return None
    return "" if isinstance(run, dict) and {"policies", "worlds"} <= set(run) else None
