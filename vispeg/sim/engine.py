"""Engines of the physics: `c`, MuJoCo's own `mujoco.batch`, and `warp`, MuJoCo Warp on a GPU or the CPU."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal, get_args

import mujoco
from mujoco import batch as mjb

from vispeg.core.effect import effect
from vispeg.core.errors import UserError
from vispeg.core.extras import require

Engine = Literal["c", "warp"]
ENGINES: tuple[str, ...] = get_args(Engine)


def batch_of(engine: str, model: mujoco.MjModel, nsim: int, nthread: int, effects: Iterable[str]) -> Any:
    """Return a batch of simulations of a model.

    Args:
        engine: one of ENGINES.
        model: the model of all rows.
        nsim: number of rows.
        nthread: threads on the host.
        effects: names of the effects that rows may have.

    Raises:
        UserError: no such engine, it is not installed, or it cannot have one of the effects.
    """
    if engine not in ENGINES:
        raise UserError("no such engine", key="engine", got=engine, choices=ENGINES)
    if engine == "c":
        return mjb.Batch(model, nsim, nthread=nthread)
    require("mujoco_warp", "the engine warp")
    from vispeg.sim.warp import WarpBatch, foreign

    for name in effects:
        if fields := foreign(effect(name).writes):
            expected = f"a world without {name}, or the engine c"
            raise UserError(f"MuJoCo Warp has one {fields[0]} for all rows", key="engine", expected=expected, got=name)
    return WarpBatch(model, nsim, nthread)
