"""What may lie on the hub: a policy or a dataset; the names of its files, how it is checked, its card."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.core.extras import require
from vispeg.datasets.describe import INFO
from vispeg.datasets.layout import VERSION
from vispeg.formats.guard import is_file, size
from vispeg.learn.shipped import META, policy_folder

NAME = r"[\w-][\w.-]*"  # no part of a path begins with a dot
Watch = Callable[[str, int, int], None]  # what is being done, by how much, of how much in all
PULL = "    vispeg hub pull {name}{flag} --out {short}\n"
POLICY_CARD = """---
library_name: vispeg
tags: [robotics, vispeg]
---
# {short}

A policy for a robot arm: `policy.safetensors` holds the weights, `policy.json` says
what it sees and where it was trained.

"""
DATASET_CARD = """---
task_categories: [robotics]
tags: [LeRobot, vispeg]
configs:
- config_name: default
  data_files: data/*/*.parquet
---
# {short}

Rendered pictures of a robot arm at work, as LeRobotDataset {version}.

"""


@dataclass(frozen=True)
class Kind:
    """One kind of content.

    Attributes:
        name: of the kind; also what a pulled folder's marker says.
        repository: the hub's word for such a repository.
        head: the file that makes a folder one of this kind.
        first: names of the small files that say what the others are; they are fetched and checked first.
        files: names of all files that the format has.
        tag: the name of the revision that loaders look for; none for a policy.
        card: the text of README.md.
    """

    name: str
    repository: str
    head: str
    first: re.Pattern[str]
    files: re.Pattern[str]
    tag: str | None
    card: str

    def begin(self, folder: Path) -> None:
        """Raises UserError where the first files are no policy's or no dataset's, or of one that is not read here."""
        if self is POLICY:
            from vispeg.learn.record import read_record

            read_record(folder)
        else:
            from vispeg.datasets.read import Dataset

            Dataset(folder)

    def check(self, folder: Path, watch: Watch = lambda name, by, total: None) -> None:
        """Raises UserError for anything that is wrong: hashes, shapes, and of a dataset what `dataset check` finds."""
        if self is POLICY:
            _check_policy(folder)
            return
        from vispeg.datasets.check import check
        from vispeg.datasets.read import Dataset

        total = len(Dataset(folder))
        if wrong := check(folder, lambda frames: watch("checking frames", frames, total)):
            more = f" (and {len(wrong) - 1} more: `vispeg dataset check`)" if len(wrong) > 1 else ""
            raise UserError(f"{wrong[0]}{more}")

    def needs(self) -> None:
        """Raises UserError where a package is missing that the check needs."""
        if self is POLICY:
            require("torch", "checking a policy")

    def limit(self, name: str, count: int) -> None:
        """Raises UserError for a policy's file that has more bytes than are read."""
        if self is POLICY:
            from vispeg.learn.policy import LARGEST

            if count > LARGEST:
                raise UserError("is too large", file=name, expected=f"at most {size(LARGEST)}", got=size(count))

    def readme(self, name: str) -> str:
        """The card of a repository OWNER/NAME."""
        short, flag = name.partition("/")[2], " --dataset" if self is DATASET else ""
        return self.card.format(short=short, version=VERSION) + PULL.format(name=name, short=short, flag=flag)


POLICY = Kind(
    "policy",
    "model",
    META,
    re.compile(r"((coarse|fine)/)?policy\.json"),
    re.compile(r"((coarse|fine)/)?policy\.(json|safetensors)"),
    None,
    POLICY_CARD,
)
DATASET = Kind(
    "dataset",
    "dataset",
    INFO,
    re.compile(rf"meta/{NAME}\.json", re.ASCII),
    re.compile(rf"(meta|data)/({NAME}/)*{NAME}\.(json|parquet|ply)", re.ASCII),
    VERSION,
    DATASET_CARD,
)


def content_of(place: str | Path) -> tuple[Path, Kind]:
    """The folder that is meant and what lies in it; a bundled policy's name stands for its folder.

    Raises:
        UserError: no such folder, or neither a policy's nor a dataset's.
    """
    folder = policy_folder(place)
    for kind in (POLICY, DATASET):
        if is_file(folder / kind.head):
            return folder, kind
    expected = f"a policy's folder ({META}) or a LeRobot dataset's ({INFO})"
    raise UserError("is neither a policy nor a dataset", file=place, expected=expected)


def _check_policy(folder: Path) -> None:
    from vispeg.learn.coarse_to_fine import open_policy
    from vispeg.learn.record import COARSE, FINE, read_record

    open_policy(folder)
    parts = [folder / COARSE, folder / FINE] if "within" in read_record(folder) else [folder]
    for part in parts:
        if "weights" not in read_record(part):
            expected = "the SHA-256 of its weights; write it again by vispeg.learn.policy.save"
            raise UserError(
                "is missing (an older version wrote this file)", file=part / META, key="weights", expected=expected
            )
