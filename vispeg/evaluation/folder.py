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
from vispeg.formats.json_data import read_json

EPISODES = "episodes.jsonl"
BEFORE = ".before"  # folder in OUT for the result that a run replaces, until the run ends


@contextmanager
def workplace(
    out: str | Path | None, result: str, overwrite: bool = False, inputs: Iterable[str | Path | None] = ()
) -> Iterator[Path]:
    """Yield the folder that `prepare` makes, locked against other processes while the body runs.

    Without `out` it is a temporary folder. If the body raises before an episode is stored, there is nothing to resume:
    the result that the run was to replace is put back, and after UserError a new or empty folder is left as it was.
    """
    if out is None:
        with TemporaryDirectory(prefix="vispeg-") as folder:
            yield Path(folder)
        return
    out = Path(out).expanduser()
    refuse(out, result, inputs)
    with claimed(out):
        new = not out.exists()
        empty = new or untouched(out)
        place = prepare(out, result, overwrite, inputs)
        try:
            yield place
        except BaseException as error:
            if not (place / EPISODES).exists():
                for path in (place / BEFORE).glob("*"):
                    path.replace(place / path.name)
                if empty and isinstance(error, UserError):
                    _clear(place, new)
            raise
        finally:
            rmtree(place / BEFORE, ignore_errors=True)


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
    kind = Path(result).stem
    page = out / ("suite.html" if kind == "compare" else f"{kind}.html")
    # a run writes its page last; folders without a marker are of versions that named the page otherwise
    done = (out / result).exists() and (page.exists() or holds(out) is None)
    if done and not overwrite:
        raise UserError("exists already; name another folder or pass --overwrite", file=out / result)
    if done:  # the new run must not continue the old one
        rmtree(out / BEFORE, ignore_errors=True)
        for old in (page.name, result, EPISODES, "run.json"):
            with written(out / old), suppress(FileNotFoundError):
                (out / BEFORE).mkdir(exist_ok=True)
                (out / old).replace(out / BEFORE / old)
    with written(out):
        out.mkdir(parents=True, exist_ok=True)
        mark(out, kind, files=())
    return out


def _kind(out: Path) -> str | None:
    """Return the kind of run in a folder, from its marker.

    It is "" for a run by a version without markers, and None where there is no run.
    """
    if (marked := holds(out)) is not None:
        return marked
    try:
        run = read_json(out / "run.json")
    except UserError:
        return None
    return "" if isinstance(run, dict) and {"policies", "worlds"} <= set(run) else None
