"""`vispeg.load`: read a saved result."""

from __future__ import annotations

from pathlib import Path

from vispeg.api.compare import ComparisonResult
from vispeg.api.diagnose import DiagnosisResult
from vispeg.api.evaluate import EvaluationResult
from vispeg.api.fit import FitResult
from vispeg.api.gap import GapResult
from vispeg.api.result import Result
from vispeg.core.errors import UserError
from vispeg.evaluation.folder import EPISODES
from vispeg.evaluation.records import read as read_episodes
from vispeg.formats.arrays import read_arrays
from vispeg.formats.json_data import read_json
from vispeg.report.record import recognised
from vispeg.worlds.model_file import load_model

RECORDS = ("diagnosis", "compare", "fit", "evaluate", "gap")


def load(folder: str | Path) -> Result:
    """Read the result in the folder of a diagnosis, a comparison, a fit, an evaluation or a gap.

    Args:
        folder: a folder written by `save` or by the command of the same name.

    Raises:
        UserError: the folder has no result, a damaged file, or one of another kind (see `recognised`).
    """
    place = Path(folder)
    kind = next((name for name in RECORDS if (place / f"{name}.json").is_file()), None)
    if kind is None:
        raise UserError("no result", file=place, expected=f"a folder with one of {', '.join(RECORDS)} as .json")
    file = place / f"{kind}.json"
    record = recognised(read_json(file), "gap" if kind == "evaluate" else kind, file)
    if kind in ("evaluate", "gap"):
        played = EvaluationResult if kind == "evaluate" else GapResult
        media = read_json(place / "media.json") if (place / "media.json").is_file() else []
        return played(record, tuple(read_episodes(place / EPISODES)), tuple(media))
    evidence = place / "evidence.npz"
    arrays = read_arrays(evidence) if evidence.is_file() else {}  # results with only contact may have none
    if kind == "compare":
        return ComparisonResult(record, arrays)
    world = load_model(place / "model.yaml")
    named = {(e["effect"], e["where"]) for e in record["effects"]}
    effects = tuple(e for e in world.effects if (e.effect, e.where) in named)
    if kind == "fit":
        return FitResult(record, world, effects, arrays=arrays)
    return DiagnosisResult(record, world, arrays, effects)  # type: ignore[arg-type]  # the file's
