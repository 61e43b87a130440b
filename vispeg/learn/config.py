"""What a training run was asked to do, as `config.yaml` in its folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import yaml

from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.formats.format import Format, enrol
from vispeg.formats.typed import typed
from vispeg.learn.settings import SacSettings
from vispeg.task.registry import FIRST, kind_of

FORMAT = "vispeg-train/1"
RECIPES = ("sac", "distill", "distill+sac")
RANGES = ("full", "schedule", "adaptive")


@dataclass(frozen=True)
class Stage:
    """One step of a curriculum.

    Attributes:
        settings: of the task in place of its own, such as its tolerance.
        radius: lateral range of starts, m; None for the task's own.
        level: how far draws may leave nominal, 0 to 1.
    """

    settings: Mapping[str, float] = field(default_factory=dict)
    radius: float | None = None
    level: float = 1.0

    def plain(self) -> dict[str, object]:
        """As the file has it: the settings by their names, beside `radius` and `level`."""
        return {**self.settings, "radius": self.radius, "level": self.level}


@dataclass(frozen=True)
class TrainConfig:
    """A run.

    Attributes:
        task: `<label>-<modality>`: the label of the world's task, see vispeg.task.contract.
        recipe: `sac`, `distill` or `distill+sac`.
        world: built-in name or path of a world file.
        steps: environment steps in all.
        seed: of everything random.
        envs: environments stepped together.
        every: environment steps between evaluations, which are also where a killed run can go on from.
        episodes: of an evaluation, on seeds that training never draws.
        target: success rate at which training may stop, reached twice in a row at the last stage; above 1 never.
        pass_rate: success rate in an evaluation that moves the curriculum on.
        stages: of the curriculum; the last one is what is trained for.
        settings: TaskConfig fields that replace the world's.
        sac: the algorithm's numbers.
        teacher: policy folder of the teacher, for `distill`.
        dataset: folder of demonstrations in LeRobot's layout: in place of a teacher, or half of each batch of `sac`.
        distill: DistillSettings fields that replace the defaults.
        device: `cpu`, `cuda` or `auto`.
        threads: of the physics and of the networks.
        ranges: how far draws may leave nominal in reinforcement: `full` is the whole ranges from the first step on,
            `schedule` opens them over the first half of the steps, `adaptive` each as the policy copes with it.
        wandb: project of Weights & Biases that the curves are sent to; "" for none.
    """

    task: str
    recipe: str = "sac"
    world: str = "nominal"
    steps: int = 100_000
    seed: int = 0
    envs: int = 16
    every: int = 5_000
    episodes: int = 50
    target: float = 2.0
    pass_rate: float = 0.8
    stages: tuple[Stage, ...] = (Stage(),)
    settings: Mapping[str, Any] = field(default_factory=dict)
    sac: SacSettings = SacSettings()
    teacher: str | None = None
    dataset: str | None = None
    distill: Mapping[str, Any] = field(default_factory=dict)
    device: str = "cpu"
    threads: int = 1
    ranges: str = "full"
    wandb: str = ""

    def __post_init__(self) -> None:
        for key in ("steps", "envs", "every", "episodes", "threads"):
            if getattr(self, key) < 1:
                raise UserError("must be at least 1", key=key, got=getattr(self, key))
        if self.recipe not in RECIPES:
            raise UserError("no such recipe", key="recipe", got=self.recipe, choices=RECIPES)
        if not all(self.task.partition("-")):
            raise UserError("no such task", key="task", got=self.task, expected="LABEL-MODALITY")
        if self.teacher is not None and self.dataset is not None:
            raise UserError("a dataset stands in place of a teacher", key="dataset", expected="one of them", got="both")
        if not self.stages:
            raise UserError("a curriculum needs a stage", key="stages")
        if self.ranges not in RANGES:
            raise UserError("no such opening of ranges", key="ranges", got=self.ranges, choices=RANGES)
        if self.ranges != "full" and self.recipe == "distill":
            raise UserError("distillation alone opens no ranges", key="ranges", expected="full", got=self.ranges)
        if self.ranges != "full" and any(stage.level != 1 for stage in self.stages):
            raise UserError("a curriculum opens the ranges itself", key="ranges", expected="full", got=self.ranges)

    @property
    def modality(self) -> str:
        """What the policy sees."""
        return self.task.partition("-")[2]

    def write(self, path: Path) -> None:
        """Write YAML."""
        data = {"format": FORMAT, **asdict(self)}
        data["settings"] = {k: list(v) if isinstance(v, tuple) else v for k, v in self.settings.items()}
        data["stages"] = [stage.plain() for stage in self.stages]
        data["sac"]["hidden"] = list(self.sac.hidden)
        write_text_atomic(path, yaml.safe_dump(data, sort_keys=False), overwrite=True)


CONFIG = Format(FORMAT, "a training run's configuration", keys=tuple(f.name for f in fields(TrainConfig)))


def _example(folder: Path) -> Path:
    kind = kind_of({})
    easier = {} if kind.tolerance is None else {kind.tolerance.setting: 6.0}
    stages = (Stage(easier), Stage())
    TrainConfig(f"{FIRST}-state", stages=stages, settings={"start_height": (0.02, 0.04)}).write(folder / "config.yaml")
    return folder / "config.yaml"


@enrol(FORMAT, _example)
def read_config(path: Path) -> TrainConfig:
    """Read what `TrainConfig.write` wrote.

    Raises:
        UserError: no such file, not YAML, an unknown key, or a value that a run cannot have.
    """
    if not path.exists():
        raise UserError("not a training run's folder", file=path, expected="config.yaml in it")
    data = dict(CONFIG.read(path))
    if isinstance(data.get("stages"), list):
        data["stages"] = [_stage(entry) for entry in data["stages"]]
    return typed(TrainConfig, data, path)


def _stage(entry: object) -> object:
    """Give an entry of `stages` as `Stage` has it; what is no mapping is left to who checks it."""
    if not isinstance(entry, Mapping):
        return entry
    settings = {key: value for key, value in entry.items() if key not in ("radius", "level") and value is not None}
    return {"settings": settings, **{key: entry[key] for key in ("radius", "level") if key in entry}}
