"""The configuration of a training run, `config.yaml` in its folder."""

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
from vispeg.sim.engine import ENGINES
from vispeg.task.registry import FIRST, kind_of

FORMAT = "vispeg-train/1"
SEEDS = 2**32  # exclusive: Stable-Baselines3 seeds NumPy's global generator, which takes 32 bits
RECIPES = ("sac", "distill", "distill+sac")
RANGES = ("full", "schedule", "adaptive")


@dataclass(frozen=True)
class Stage:
    """One step of a curriculum.

    Attributes:
        settings: task settings that this stage replaces, such as the tolerance.
        radius: lateral range of starts, m; None for the task's own.
        level: share of the world's ranges that is drawn from: 0 is the nominal world, 1 the full ranges.
    """

    settings: Mapping[str, float] = field(default_factory=dict)
    radius: float | None = None
    level: float = 1.0

    def __post_init__(self) -> None:
        if not 0 <= self.level <= 1:
            raise UserError("not a share", key="level", expected="0 to 1", got=self.level)

    def plain(self) -> dict[str, object]:
        """Return the stage as config.yaml holds it: the settings by name, with `radius` and `level`."""
        return {**self.settings, "radius": self.radius, "level": self.level}


@dataclass(frozen=True)
class TrainConfig:
    """The configuration of a training run. Raises UserError for an invalid value.

    Attributes:
        task: `<label>-<modality>`: the label of the world's task, see vispeg.task.contract.
        recipe: `sac`, `distill` or `distill+sac`.
        world: built-in name or path of a world file.
        steps: total number of environment steps.
        seed: seed of everything random, 0 to 2^32 - 1.
        envs: number of environments stepped together.
        every: environment steps between evaluations; each evaluation also writes the checkpoint that a killed run
            resumes from.
        episodes: number of episodes in an evaluation, on seeds that training never draws.
        target: success rate that ends training early, once two evaluations in a row reach it at the last stage; above
            1 for never.
        pass_rate: success rate in an evaluation that moves the curriculum to its next stage.
        stages: the curriculum's stages; the last one is the task that is trained for.
        settings: TaskConfig fields that replace the world's.
        sac: settings of soft actor-critic.
        teacher: the teacher's policy folder, or `expert` for the scripted one; for the recipes with `distill`.
        dataset: folder of demonstrations in LeRobot's layout: with `distill` in place of a teacher, with `sac` the
            share `sac.demo_fraction` of each batch.
        distill: DistillSettings fields that replace the defaults.
        device: `cpu`, `cuda` or `auto`.
        threads: number of threads, for the physics and for the networks.
        engine: of the physics of training, see `vispeg.sim.engine`; evaluations are always on `c`.
        ranges: how the world's ranges open during reinforcement learning: `full` draws from the full ranges from the
            first step on, `schedule` widens them over the first half of the steps, `adaptive` widens each one as the
            policy succeeds at its edge.
        wandb: Weights & Biases project that receives the curves; "" for none.
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
    engine: str = "c"
    ranges: str = "full"
    wandb: str = ""

    def __post_init__(self) -> None:
        if not 0 <= self.seed < SEEDS:
            raise UserError("not a seed of a training", key="seed", expected="0 to 2^32 - 1", got=self.seed)
        for key in ("steps", "envs", "every", "episodes", "threads"):
            if getattr(self, key) < 1:
                raise UserError("must be at least 1", key=key, got=getattr(self, key))
        if self.recipe not in RECIPES:
            raise UserError("no such recipe", key="recipe", got=self.recipe, choices=RECIPES)
        if self.engine not in ENGINES:
            raise UserError("no such engine", key="engine", got=self.engine, choices=ENGINES)
        if self.engine != "c" and (self.recipe != "distill" or self.dataset is not None):
            got = "a dataset" if self.dataset is not None else self.recipe
            expected = "the recipe distill with a teacher"
            raise UserError(
                f"{self.engine} is for the imitation of a teacher", key="engine", expected=expected, got=got
            )
        if not all(self.task.partition("-")):
            raise UserError("no such task", key="task", got=self.task, expected="LABEL-MODALITY")
        if self.teacher is not None and self.dataset is not None:
            raise UserError("a dataset takes the place of a teacher", key="dataset", expected="one of them", got="both")
        if not self.stages:
            raise UserError("a curriculum needs a stage", key="stages")
        if len(self.stages) > 1 and self.recipe == "distill":
            raise UserError("distillation alone has no stages", key="stages", expected="one", got=len(self.stages))
        if self.ranges not in RANGES:
            raise UserError("no such way to open the ranges", key="ranges", got=self.ranges, choices=RANGES)
        if self.ranges != "full" and self.recipe == "distill":
            raise UserError("distillation alone opens no ranges", key="ranges", expected="full", got=self.ranges)
        if self.ranges != "full" and any(stage.level != 1 for stage in self.stages):
            raise UserError("a curriculum opens the ranges itself", key="ranges", expected="full", got=self.ranges)

    @property
    def modality(self) -> str:
        """The name of the policy's modality."""
        return self.task.partition("-")[2]

    def text(self) -> str:
        """Return the configuration as YAML."""
        data = {"format": FORMAT, **asdict(self)}
        data["stages"] = [stage.plain() for stage in self.stages]
        return yaml.safe_dump(data, sort_keys=False)

    def write(self, path: Path) -> None:
        """Write the configuration as YAML; replace the file if it exists."""
        write_text_atomic(path, self.text(), overwrite=True)


CONFIG = Format(FORMAT, "a training run's configuration", keys=tuple(f.name for f in fields(TrainConfig)))


def _example(folder: Path) -> Path:
    """Write an example for the tests of the format."""
    kind = kind_of({})
    easier = {} if kind.tolerance is None else {kind.tolerance.setting: 6.0}
    stages = (Stage(easier), Stage())
    TrainConfig(f"{FIRST}-state", stages=stages, settings={"start_height": (0.02, 0.04)}).write(folder / "config.yaml")
    return folder / "config.yaml"


@enrol(FORMAT, _example)
def read_config(path: Path) -> TrainConfig:
    """Read what `TrainConfig.write` wrote.

    Raises:
        UserError: no such file, not YAML, an unknown key, or an invalid value.
    """
    if not path.exists():
        raise UserError("not a training run's folder", file=path, expected="config.yaml in it")
    data = dict(CONFIG.read(path))
    if isinstance(data.get("stages"), list):
        data["stages"] = [_stage(entry) for entry in data["stages"]]
    return typed(TrainConfig, data, path)


def _stage(entry: object) -> object:
    """Return an entry of `stages` with the keys of `Stage`: undo `Stage.plain`.

    Older files state null for a setting that a stage does not replace. What is not a mapping is left to `typed`, which
    refuses it.
    """
    if not isinstance(entry, Mapping):
        return entry
    settings = {key: value for key, value in entry.items() if key not in ("radius", "level") and value is not None}
    return {"settings": settings, **{key: entry[key] for key in ("radius", "level") if key in entry}}
