"""What a diagnosis leaves open, priced in success: a policy in the cell with the identified model, and with the rest.

The same seeds are played twice. First every identified value is what the fit says. Then each is drawn from its 95 %
interval, and the torque that no effect explains is played back in every joint as random torque of its size.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from vispeg.core.effect import effect
from vispeg.core.files import write_text_atomic
from vispeg.evaluation.jobs import Setting
from vispeg.evaluation.records import Episode
from vispeg.evaluation.schema.stress import Priced
from vispeg.evaluation.statistics.crossed import difference, rate
from vispeg.evaluation.statistics.decide import decide
from vispeg.evaluation.statistics.significance import mcnemar
from vispeg.evaluation.table import Cell, Table
from vispeg.task.world_file import FORMAT, WorldFile
from vispeg.worlds.model_file import model_text
from vispeg.worlds.world import World

IDENTIFIED, LEFT = "as identified", "with what is left"


def settings(base: WorldFile, identified: World, remainder: Sequence[Mapping[str, Any]], folder: Path) -> list[Setting]:
    """Both settings; their worlds and the model are written into `folder`.

    Args:
        base: the cell, and whatever else varies in it.
        identified: the identified model.
        remainder: of each joint the RMS of the missing torque, N m, as in diagnosis.json; none is none.
        folder: for the files.

    Raises:
        UserError: the model is of another robot than the cell's, or has an effect that the cell has no place for.
    """
    model = write_text_atomic(folder / "model.yaml", model_text(identified), overwrite=True)
    most = effect("torque_noise").params["rms"].high
    noise = [
        {"effect": "torque_noise", "where": r["joint"], "params": {"rms": min(float(r["rms"]), most)}}
        for r in remainder
        if r["rms"] > 0
    ]
    made = []
    for tag, sd, effects in ((IDENTIFIED, 0.0, []), (LEFT, 1.0, noise)):
        data = {"format": FORMAT, "name": base.name, "base": str(base.path.resolve())}
        data |= {"model": {"file": str(model.resolve()), "widen": 0.0, "sd": sd}, "effects": effects}
        path = folder / f"{tag.replace(' ', '-')}.yaml"
        write_text_atomic(path, yaml.safe_dump(data, sort_keys=False), overwrite=True)
        made.append(Setting(str(path), base.name, tag))
    return made


def summarise(episodes: Sequence[Episode]) -> list[Priced]:
    """Of each policy the success in both settings and what the difference costs, paired over seeds."""
    rows: list[Priced] = []
    for policy in dict.fromkeys(e.policy for e in episodes):
        of_policy = [e for e in episodes if e.policy == policy]
        table = Table([replace(e, world=e.configuration, configuration="") for e in of_policy])
        y = table.aligned(policy, [IDENTIFIED, LEFT])
        cost = difference(y[IDENTIFIED], y[LEFT], same_networks=True)
        p = mcnemar(y[IDENTIFIED], y[LEFT]).p
        row: Priced = {
            "policy": policy,
            "modality": of_policy[0].modality,
            "identified": rate(table.outcomes(Cell(policy, IDENTIFIED))).to_json(),
            "left": rate(table.outcomes(Cell(policy, LEFT))).to_json(),
            "cost": cost.to_json(),
            "p": p,
            "verdict": decide(cost, p),
        }
        rows.append(row)
    return rows
