"""Prepare the folder of an evaluation: a new one, one with a stopped run to resume, or one to replace."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory

from vispeg.core.disk import written
from vispeg.core.errors import UserError
from vispeg.core.lock import LOCK, claimed
from vispeg.core.marker import apart, holds, mark, untouched
from vispeg.core.paths import expanded
from vispeg.formats.json_data import read_json

EPISODES, RUN = "episodes.jsonl", "run.json"
BEFORE = ".before"  # folder in OUT for the result that a run replaces, until the run ends


@contextmanager
def workplace(
    out: str | Path | None, result: str, overwrite: bool = False, inputs: Iterable[str | Path | None] = ()
) -> Iterator[Path]:
    """Yield the folder that `prepare` makes, locked against other processes while the body runs.

    Without `out` it is a temporary folder. A run that ends before an episode is stored leaves nothing to resume: the
    result that it was to replace is put back, at once if it raises, by the next run if it was killed. After UserError a
    new or empty folder is left as it was.
    """
    if out is None:
        with TemporaryDirectory(prefix="vispeg-") as folder:
            yield Path(folder)
        return
    out = expanded(out)
    refuse(out, result, inputs)
    with claimed(out):
        new = not out.exists()
        empty = new or untouched(out)
        try:
            _put_back(out, result)
            yield prepare(out, result, overwrite, inputs)
        except BaseException as error:
            _put_back(out, result)
            if empty and isinstance(error, UserError) and out.is_dir() and not (out / EPISODES).exists():
                _clear(out, new)
            raise
        rmtree(out / BEFORE, ignore_errors=True)


def _put_aside(out: Path, result: str) -> None:
    """Move a finished result into BEFORE: its episodes first, so that those of the run that replaces it are known."""
    rmtree(out / BEFORE, ignore_errors=True)
    for name in (EPISODES, result, _page(result), RUN):
        with written(out / name), suppress(FileNotFoundError):
            (out / BEFORE).mkdir(exist_ok=True)
            (out / name).replace(out / BEFORE / name)


def _put_back(out: Path, result: str) -> None:
    """Move what a run put aside back into the folder, its episodes last, or drop it if there is something newer.

    That is an episode of the run, or the whole result of one that plays none.
    """
    before = out / BEFORE
    finished = (before / result).exists() and _finished(out, result)
    if not finished and not (out / EPISODES).exists():
        for name in (RUN, _page(result), result, EPISODES):
            with written(out / name), suppress(FileNotFoundError):
                (before / name).replace(out / name)
    rmtree(before, ignore_errors=True)


def _finished(out: Path, result: str) -> bool:
    """Return whether the folder holds a whole result: a run writes its page last.

    Folders without a marker are of versions that named the page otherwise.
    """
    return (out / result).exists() and ((out / _page(result)).exists() or holds(out) is None)


def _page(result: str) -> str:
    """Return the name of the page beside a result."""
    kind = Path(result).stem
    return "suite.html" if kind == "compare" else f"{kind}.html"


def _clear(folder: Path, new: bool) -> None:
    """Remove what a run put into a folder that was empty before, and a `new` folder itself."""
    for path in folder.iterdir():
        if path.is_dir():
            rmtree(path, ignore_errors=True)
        elif path.name != LOCK:
            path.unlink(missing_ok=True)
    if new:
        with suppress(OSError):
            folder.rmdir()


def refuse(out: Path, result: str, inputs: Iterable[str | Path | None] = ()) -> None:
    """Raise UserError where `out` is no folder for such results, or is one of the inputs or above one."""
    kind = Path(result).stem
    apart(out, inputs)
    if out.is_file() or (out.is_dir() and not untouched(out) and _kind(out) not in (kind, "")):
        raise UserError("is not a folder of such results", file=out, expected="a new or empty folder, or one of a run")


def prepare(out: Path, result: str, overwrite: bool, inputs: Iterable[str | Path | None] = ()) -> Path:
    """Make the folder, or put a finished result in it aside (BEFORE); return it.

    A stopped run without a result is kept, so that it can be resumed.

    Args:
        out: the folder.
        result: name of the file that a finished run has written.
        overwrite: whether a finished result may be replaced.
        inputs: files and folders that the run reads; `out` may be none of them, nor a folder above one.

    Raises:
        UserError: there is a finished result and `overwrite` is False, the folder holds something else, or it cannot
            be written.
    """
    refuse(out, result, inputs)
    if _finished(out, result):
        if not overwrite:
            raise UserError("exists already; name another folder or pass --overwrite", file=out / result)
        _put_aside(out, result)  # the new run must not continue the old one
    with written(out):
        out.mkdir(parents=True, exist_ok=True)
        mark(out, Path(result).stem, files=())
    return out


def _kind(out: Path) -> str | None:
    """Return the kind of run in a folder, from its marker.

    It is "" for a run by a version without markers, and None where there is no run.
    """
    if (marked := holds(out)) is not None:
        return marked
    try:
        run = read_json(out / RUN)
    except UserError:
        return None
    return "" if isinstance(run, dict) and {"policies", "worlds"} <= set(run) else None
