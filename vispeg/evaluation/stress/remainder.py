"""Cost of a diagnosis's unexplained residual: success of a policy in the identified model, without and with it.

The same seeds are played twice. First every identified value is what the fit says. Then each is drawn from its 95 %
interval, and the torque that no effect explains is played back in every joint as random torque of its size.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from vispeg.core.effect import effect
from vispeg.core.files import write_text_atomic
from vispeg.evaluation.jobs import Setting
from vispeg.evaluation.records import Episode
from vispeg.evaluation.schema.stress import Priced
from vispeg.evaluation.statistics import decide, difference, rate
from vispeg.evaluation.table import rows
from vispeg.task.world_file import FORMAT, WorldFile
from vispeg.worlds.model_file import write_model
from vispeg.worlds.world import World

IDENTIFIED, LEFT = "as identified", "with what is left"


def settings(base: WorldFile, identified: World, remainder: Sequence[Mapping[str, Any]], folder: Path) -> list[Setting]:
    """Return both settings; write their worlds and the model into `folder`.

    Args:
        base: the world with the cell and whatever else varies in it.
        identified: the identified model.
        remainder: RMS of the missing torque in each joint, N m, as in diagnosis.json; empty for none.
        folder: for the files.

    Raises:
        UserError: the model is of another robot than the cell's, or has an effect that the cell has no place for.
    """
    model = write_model(folder / "model.yaml", identified, overwrite=True)
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
    """Return each policy's success in both settings and its loss; the tests of all policies are one family."""
    sides = {
        p: [rows(e for e in episodes if (e.policy, e.configuration) == (p, setting)) for setting in (IDENTIFIED, LEFT)]
        for p in dict.fromkeys(e.policy for e in episodes)
    }
    decided = decide({policy: difference(*both, same_networks=True) for policy, both in sides.items()})
    return [
        {
            "policy": policy,
            "modality": next(e.modality for e in episodes if e.policy == policy),
            "identified": rate(identified).to_json(),
            "left": rate(left).to_json(),
            "cost": decided[policy].estimate.to_json(),
            "p": decided[policy].test.p,
            "p_holm": decided[policy].p_holm,
            "verdict": decided[policy].verdict,
        }
        for policy, (identified, left) in sides.items()
    ]
