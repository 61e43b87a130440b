"""Episodes for the Rerun viewer: the cell in 3D, what the policy sees, the force, where it takes the tip to be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from vispeg.evaluation.entrants import Entrant
from vispeg.evaluation.films.moments import Moment, moments, stage
from vispeg.report.live.shapes import colour_of, shape_of, visible
from vispeg.report.rrd.stream import Stream, entity, stream
from vispeg.sim.compiled import compiled

AXES = "xyz"
ROOM = 2.5  # m: floor and walls are larger, and would make the cell small


@dataclass(frozen=True)
class Shown:
    """An episode: its name, the cell's model without its effects, and its moments."""

    name: str
    model: mujoco.MjModel
    moments: Sequence[Moment]


def write_episodes(path: Path, title: str, episodes: Sequence[Shown]) -> Path:
    """Write a file with all of them, each in a tab of its own; return the path. Raises UserError as `stream`."""
    with stream(path, title) as out:
        for episode in episodes:
            _episode(out, episode)
        out.arrange(*_tabs(episodes))
    return path


def played(who: Entrant, world: str, settings: Mapping[str, Any], seeds: Sequence[int], name: str = "") -> list[Shown]:
    """Plays an episode a seed (see `vispeg.evaluation.films.moments.stage`); they are called `name` and their seed."""
    episodes = []
    with stage(who, world, settings) as (env, policy, at):
        for seed in seeds:
            title = " ".join(filter(None, (name, at, f"seed {seed}")))
            episodes.append(Shown(title, compiled(env.sim.scene), list(moments(env, policy, seed))))
    return episodes


def placed(model: mujoco.MjModel, steps: Sequence[Moment]) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, nbody, 3) m and quaternions (T, nbody, 4) wxyz of every body, in the world's axes."""
    import copy

    scratch = copy.copy(model)  # bodies are placed in it
    data = mujoco.MjData(scratch)
    pos, quat = np.empty((len(steps), scratch.nbody, 3)), np.empty((len(steps), scratch.nbody, 4))
    for t, moment in enumerate(steps):
        for name, place in moment.bodies.items():
            body = scratch.body(name).id
            scratch.body_pos[body], scratch.body_quat[body] = place[:3], place[3:]
        data.qpos[:] = moment.qpos
        mujoco.mj_kinematics(scratch, data)
        pos[t], quat[t] = data.xpos, data.xquat
    return pos, quat


def _episode(out: Stream, episode: Shown) -> None:
    root, model, steps = episode.name, episode.model, episode.moments
    time = np.array([m.time for m in steps])
    pos, quat = placed(model, steps)
    bodies = set()
    for g in visible(model):
        shape = shape_of(model, g)
        if shape is None or np.ptp(shape[0], axis=0).max() > ROOM:
            continue
        body = int(model.geom_bodyid[g])
        bodies.add(body)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[g])
        vertices = shape[0] @ turn.reshape(3, 3).T + model.geom_pos[g]
        colour = np.round(255 * np.clip(colour_of(model, g), 0, 1)).astype(np.uint8)
        out.mesh(
            entity(root, "cell", model.body(body).name, f"geom{g}"),
            vertices,
            shape[1],
            np.tile(colour, (len(vertices), 1)),
        )
    for body in sorted(bodies):
        out.place(entity(root, "cell", model.body(body).name), time, pos[:, body], quat[:, body])
    force = np.stack([m.force for m in steps])
    out.lines((root, "force N"), time, {axis: force[:, k] for k, axis in enumerate(AXES)})
    offset = np.stack([m.offset for m in steps])
    out.lines((root, "tip mm"), time, {f"{axis} true": offset[:, k] for k, axis in enumerate(AXES)})
    if steps[0].estimate is not None:
        thought = np.stack([np.full(3, np.nan) if m.estimate is None else m.estimate for m in steps])
        out.lines((root, "tip mm"), time, {f"{axis} estimated": thought[:, k] for k, axis in enumerate(AXES)})
    for moment in steps:
        for key, image in moment.pictures.items():
            out.picture(entity(root, "sees", key), moment.time, image)
    out.say(entity(root, "outcome"), steps[-1].time, steps[-1].outcome)


def _tabs(episodes: Sequence[Shown]) -> list[object]:
    """Give a tab an episode: the cell beside pictures, force and tip."""
    import rerun.blueprint as rrb

    tabs = []
    for episode in episodes:
        root = episode.name
        pictures = [
            rrb.Spatial2DView(origin=entity(root, "sees", key), name=key) for key in episode.moments[0].pictures
        ]
        side = [
            *([rrb.Horizontal(*pictures)] if pictures else []),
            rrb.TimeSeriesView(origin=entity(root, "force N"), name="force at the wrist, N"),
            rrb.TimeSeriesView(origin=entity(root, "tip mm"), name="tip in the goal's frame, mm"),
        ]
        cell = rrb.Spatial3DView(origin=entity(root, "cell"), name="cell")
        tabs.append(rrb.Horizontal(cell, rrb.Vertical(*side), name=episode.name))
    return [rrb.Tabs(*tabs)]
