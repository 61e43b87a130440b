"""Sort what the user names on the command line into what each page opens, by content."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.formats.guard import is_file
from vispeg.learn.shipped import names
from vispeg.recordings.cell import OPEN_CELL
from vispeg.robots.model import available
from vispeg.task.world_file import is_world
from vispeg.view.around import HEADS, kind_of
from vispeg.view.run_folder import newest

EXPECTED = "a recording, a folder of some, a log, a model, a world, a policy, a dataset, a training run, or trials"


@dataclass(frozen=True)
class Opened:
    """What each page opens at the start; any of it may be empty.

    Attributes:
        recordings: folders of recordings.
        model: a model in any form that `vispeg diagnose` accepts.
        logs: log files, which must be imported first.
        world: a world's name or file; "" if none was named.
        policy: a policy's name or folder; "" if none was named.
        dataset, run, trials: folder of a dataset, of a training run, of trials; "" if none was named.
    """

    recordings: tuple[Path, ...] = ()
    model: str = "iiwa14"
    logs: tuple[Path, ...] = ()
    world: str = ""
    policy: str = ""
    dataset: str = ""
    run: str = ""
    trials: str = ""

    @property
    def page(self) -> str:
        """Title of the page that opens first."""
        if self.recordings:
            return "Diagnose"
        named = {"Trials": self.trials, "Policies": self.policy, "Training": self.run, "Data": self.dataset}
        named |= {"Worlds": self.world}
        return next((title for title, what in named.items() if what), "Import" if self.logs else "Diagnose")


def opened(sources: Sequence[str], chosen: str | None = None) -> Opened:
    """Recognize each source.

    Args:
        sources: names, files and folders of any known kind.
        chosen: the model, in place of any in `sources`.

    Raises:
        UserError: a source that does not exist, or that cannot be shown.
    """
    recordings: list[Path] = []
    logs: list[Path] = []
    model, world, policy, dataset, run, trials = "iiwa14", "", "", "", "", ""
    for text in sources:
        path = Path(text)
        kind = kind_of(path)
        if not path.exists() and text in names():
            policy = text
        elif not path.exists() and text in (*available(), OPEN_CELL):
            model = text
        elif kind == "world" or not path.is_dir() and _is_world(text):
            world = text
        elif not path.exists():
            raise UserError("is not there", file=text, expected=EXPECTED)
        elif kind == "policy":
            policy = text
        elif kind == "recording":
            recordings.append(path)
        elif kind == "dataset":
            dataset = text
        elif kind == "trials":
            trials = text
        elif path.is_dir() and (inside := _recordings(path)):
            recordings += inside
        elif path.is_dir() and newest(path) is not None:
            run = text
        elif path.is_dir() and (path / "model.yaml").is_file():
            model = str(path / "model.yaml")
        elif kind == "log":
            logs.append(path)
        elif (
            kind == "model" or is_file(path) and path.suffix.lower() in HEADS
        ):  # reading an invalid model names the fault
            model = str(path)
        else:
            raise UserError("cannot be shown", file=text, expected=EXPECTED)
    return Opened(tuple(dict.fromkeys(recordings)), chosen or model, tuple(logs), world, policy, dataset, run, trials)


def _recordings(folder: Path) -> list[Path]:
    return sorted(child for child in folder.iterdir() if (child / "recording.yaml").is_file())


def _is_world(text: str) -> bool:
    """Return whether this is the name of a built-in world, or an existing file that describes a world."""
    yaml = Path(text).suffix.lower() in (".yaml", ".yml")
    return (Path(text).is_file() or not yaml) and is_world(text)
