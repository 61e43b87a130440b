"""A policy or a dataset to the hub: checked first, the format's files alone, one commit, and LeRobot's tag."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vispeg.api.hub.content import Kind, Watch, content_of
from vispeg.api.hub.repository import Repository
from vispeg.core.errors import UserError

README = "README.md"


@dataclass(frozen=True)
class Pushed:
    """What was sent.

    Attributes:
        kind: `policy` or `dataset`.
        commit: hash of the commit that holds it.
        url: of that commit.
        files: names in the repository.
        tag: the tag that was put there; None where none was.
    """

    kind: str
    commit: str
    url: str
    files: tuple[str, ...]
    tag: str | None


def push(
    folder: str | Path,
    name: str,
    *,
    revision: str | None = None,
    private: bool = False,
    overwrite: bool = False,
    watch: Watch = lambda name, by, total: None,
) -> Pushed:
    """Sends a folder's policy or dataset to the repository OWNER/NAME.

    A README.md that is there stays. Files of the format that are there and not sent are removed by the same commit.
    LeRobot's loader takes the revision that has the tag of the dataset's version: a push to the main branch puts it
    there.

    Args:
        folder: of the policy or dataset, or a bundled policy's name.
        name: OWNER/NAME.
        revision: branch, made if need be; the main one where None.
        private: whether a new repository is.
        overwrite: whether a policy or dataset that is there is replaced, by a new commit.
        watch: hears what is being done, by how many bytes or frames, of how many.

    Raises:
        UserError: nothing to push or something wrong with it, no login, the hub refuses or does not answer, or what is
            there must not be replaced. Nothing was changed on the hub then, but that a repository may have been made.
    """
    path, kind = content_of(folder)
    hub = Repository(name, kind.repository)
    kind.needs()
    files = files_of(path, kind)
    kind.check(path, watch)
    hub.logged_in()
    before = hub.there()
    if before is not None and private and not before.private:
        raise UserError("is public; --private is for a new repository", file=name)
    at = hub.there(revision) if revision is not None else before
    old = sorted(n for n in at.sizes if kind.files.fullmatch(n)) if at is not None else []
    if old and not overwrite:
        raise UserError(f"holds a {kind.name} already; name another or pass --overwrite", file=name)
    sent: dict[str, Path | bytes] = {**files}
    if at is None or README not in at.sizes:
        sent[README] = kind.readme(name).encode("utf-8")
    hub.create(private, revision)
    total = sum(file.stat().st_size for file in files.values())
    commit, url = hub.commit(
        sent, [n for n in old if n not in files], revision, lambda by: watch("sending kB", by, total)
    )
    tag = kind.tag if revision is None else None
    if tag is not None:
        hub.tag(tag, commit)
    return Pushed(kind.name, commit, url, tuple(sent), tag)


def files_of(folder: Path, kind: Kind) -> dict[str, Path]:
    """Name in the repository -> path of each file of the format in a folder; nothing else is sent."""
    paths = sorted(p for p in folder.rglob("*") if p.is_file())
    named = {p.relative_to(folder).as_posix(): p for p in paths}
    return {name: path for name, path in named.items() if kind.files.fullmatch(name)}
