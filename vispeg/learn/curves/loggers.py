"""Log a run's curves to TensorBoard and, where the run asks for it, to Weights & Biases."""

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

LOGGED = ("success", "reward", "peak_force", "train_success", "level", "actor_loss")
RUN_ID = "wandb.json"  # the folder's run id at Weights & Biases, so that a resumed run continues there
STEP = "steps"


def curves(folder: Path, config: TrainConfig) -> Logger:
    """Return a logger to TensorBoard files in the run's folder and, if the run names a project, to Weights & Biases.

    Without TensorBoard installed, no files for it are written.

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
    """Log the LOGGED columns of an evaluation's row at a step, each under the name `STAGE/COLUMN`."""
    for name in LOGGED:
        if (value := row.get(name)) is not None:
            logger.record(f"{stage}/{name}", value)
    logger.dump(step)


class WeightsAndBiases(KVWriter):
    """Send what is logged to a run at Weights & Biases, named after the folder; WANDB_MODE sets the mode.

    Args:
        folder: the run's folder; its `wandb/` keeps what is not sent yet.
        config: the run's configuration, which names the project.

    Raises:
        UserError: the extra `wandb` is missing, or Weights & Biases refuses the run.
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
        """Send the numeric values of a step."""
        self.run.log({**{k: v for k, v in key_values.items() if isinstance(v, int | float)}, STEP: step})

    def close(self) -> None:
        """Send what is left and end the session; the run can be resumed."""
        self.run.finish()


def _run_id(folder: Path) -> str:
    """Return the id of the folder's run at Weights & Biases; make and store one if there is none yet."""
    file = folder / RUN_ID
    try:
        return str(read_json(file)["id"])
    except (UserError, KeyError, TypeError):
        made = uuid4().hex[:12]
        write_text_atomic(file, json.dumps({"id": made}) + "\n", overwrite=True)
        return made
