"""A policy or a dataset from the hub: one commit, the format's files alone, checked before the folder has its name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vispeg.api.hub.content import DATASET, POLICY, Watch
from vispeg.api.hub.repository import Repository
from vispeg.core.errors import UserError
from vispeg.core.files import new_folder, refuse


@dataclass(frozen=True)
class Pulled:
    """What came.

    Attributes:
        kind: `policy` or `dataset`.
        commit: hash of the commit that it is of.
        files: their names.
    """

    kind: str
    commit: str
    files: tuple[str, ...]


def pull(
    name: str,
    out: str | Path,
    *,
    dataset: bool = False,
    revision: str | None = None,
    overwrite: bool = False,
    watch: Watch = lambda name, by, total: None,
) -> Pulled:
    """Downloads the policy or the dataset of the repository OWNER/NAME into a new folder.

    Nothing of it is executed. A dataset whose repository has the tag of the version that is read here is taken from
    there, as LeRobot's loader does, else from the main branch.

    Args:
        name: OWNER/NAME.
        out: the folder.
        dataset: whether it is a dataset.
        revision: branch, tag or commit.
        overwrite: whether a folder that is there is replaced.
        watch: hears what is being done, by how many bytes or frames, of how many.

    Raises:
        UserError: no such repository or revision, the hub does not answer, no policy or dataset, anything that is wrong
            with it (see `Kind.check`), or `out` exists. Nothing is written then.
    """
    kind = DATASET if dataset else POLICY
    refuse(out, overwrite, holds=kind.name)
    hub = Repository(name, kind.repository)
    kind.needs()
    if revision is None and kind.tag is not None and kind.tag in hub.tags():
        revision = kind.tag
    state = hub.at(revision)
    files = {n: size for n, size in state.sizes.items() if kind.files.fullmatch(n)}
    if kind.head not in files:
        raise UserError(f"holds no {kind.name}", file=name, expected=kind.head, got=sorted(state.sizes)[:5])
    for n, size in files.items():
        kind.limit(n, size)
    first = sorted(n for n in files if kind.first.fullmatch(n))
    rest = sorted(files.keys() - set(first))
    total = sum(files.values())
    with new_folder(out, overwrite, holds=kind.name) as folder:
        hub.fetch(state, first, folder, lambda by: watch("fetching kB", by, total))
        kind.begin(folder)
        hub.fetch(state, rest, folder, lambda by: watch("fetching kB", by, total))
        kind.check(folder, watch)
    return Pulled(kind.name, state.commit, tuple(sorted(files)))
