"""Where a run's curves go beside progress.csv: TensorBoard, and Weights & Biases where the run asks for it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any
from uuid import uuid4

from stable_baselines3.common.logger import KVWriter, Logger

from vispeg.core.errors import UserError
from vispeg.core.extras import require
from vispeg.core.files import write_text_atomic
from vispeg.formats.json_data import read_json
from vispeg.learn.config import TrainConfig
from vispeg.learn.curves.progress import Row

TOLD = ("success", "reward", "peak_force", "train_success", "level", "actor_loss")
RUN_ID = "wandb.json"  # which run of Weights & Biases a folder is: a resumed one goes on there
STEP = "steps"


def curves(folder: Path, config: TrainConfig) -> Logger:
    """Give a logger into the run's folder and, where the configuration names a project, into Weights & Biases.

    Nothing goes to TensorBoard where it is not installed.

    Raises:
        UserError: the extra `wandb` is missing, or Weights & Biases refuses the run (no login, no network).
    """
    try:
        from stable_baselines3.common.logger import TensorBoardOutputFormat

        outputs: list[KVWriter] = [TensorBoardOutputFormat(str(folder / "tensorboard"))]
    except (ImportError, AssertionError):
        outputs = []
    if config.wandb:
        outputs.append(WeightsAndBiases(folder, config))
    return Logger(str(folder / "tensorboard"), outputs)


def record(logger: Logger, row: Row, stage: str, step: int) -> None:
    """Give an evaluation's row as `STAGE/success` and so on, at a step."""
    for name in TOLD:
        if (value := row.get(name)) is not None:
            logger.record(f"{stage}/{name}", value)
    logger.dump(step)


class WeightsAndBiases(KVWriter):
    """Sends what is logged to a run of Weights & Biases, named after the folder; the mode is WANDB_MODE's.

    Args:
        folder: of the run; its `wandb/` keeps what is not sent yet.
        config: of the run, with the project.
    """

    def __init__(self, folder: Path, config: TrainConfig):
        require("wandb", "--wandb")
        import wandb

        quiet = wandb.Settings(silent=True, console="off", x_disable_meta=True, disable_code=True, disable_git=True)
        try:
            self.run: Any = wandb.init(
                project=config.wandb,
                id=_run_id(folder),
                name=folder.name,
                dir=str(folder),
                config=asdict(config),
                resume="allow",
                settings=quiet,
            )
        except (wandb.Error, OSError) as error:
            raise UserError(
                f"Weights & Biases refuses the run: {str(error).splitlines()[0]}",
                key="--wandb",
                expected="`wandb login`, or WANDB_MODE=offline",
            ) from error
        self.run.define_metric(STEP)
        self.run.define_metric("*", step_metric=STEP)

    def write(self, key_values: dict[str, Any], key_excluded: Mapping[str, tuple[str, ...]], step: int = 0) -> None:
        """Send numbers of a step."""
        self.run.log({**{k: v for k, v in key_values.items() if isinstance(v, int | float)}, STEP: step})

    def close(self) -> None:
        """Send the rest; the run can be gone on with."""
        self.run.finish()


def _run_id(folder: Path) -> str:
    """Give the id that the folder's run has there, made where it has none yet."""
    file = folder / RUN_ID
    try:
        return str(read_json(file)["id"])
    except (UserError, KeyError, TypeError):
        made = uuid4().hex[:12]
        write_text_atomic(file, json.dumps({"id": made}) + "\n", overwrite=True)
        return made
