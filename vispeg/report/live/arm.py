"""The interactive arm in a page: its shapes and joints, as arrays of `evidence.npz` and as data for the script."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.report.live.shapes import BARE, colour_of, shape_of, simplified, skeleton, visible
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled
from vispeg.worlds.world import World

SCRIPTS = ("arm.js",)
FACES, FEWEST = 12_000, 60  # most faces in all, and fewest to which one shape is reduced
KEYS = ("parent", "pos", "quat", "joint", "axis", "anchor", "zero", "vertex", "face", "colour", "body")


def with_arms(world: World, arrays: dict[str, np.ndarray]) -> None:
    """Add the arm's arrays to the arrays of a result, and to those of its joints channel if it has several channels."""
    for at in ("", "channel/joints/"):
        if f"{at}joints" in arrays:
            arrays.update({f"{at}{key}": value for key, value in arm_arrays(world, arrays[f"{at}joints"]).items()})


def arm_arrays(world: World, joints: Iterable[str]) -> dict[str, np.ndarray]:
    """Return the arm of a world, without effects, as arrays `arm/KEY`; empty if it cannot be drawn.

    For nb bodies: `parent` (nb,), and `pos` (nb, 3), m, and `quat` (nb, 4), w x y z, in the parent. For k moved joints,
    in kinematic order: `joint` (k, 2), body and index in `joints`; `axis` and `anchor` (k, 3) in the body; `zero` (k,),
    rad. For V vertices and F faces: `vertex` (V, 3), m, in its body; `body` (V,); `colour` (V, 3) uint8; `face` (F, 3).
    """
    names = [str(name) for name in joints]
    try:
        model = compiled(load(world.robot, tool=world.tool))
    except UserError:  # the result is complete without a picture
        return {}
    parts = _shapes(model)
    rows = [j for j in range(model.njnt) if model.joint(j).name in names and _turns(model, j)]
    if not parts or not rows:
        return {}
    sizes = np.cumsum([0, *(len(v) for v, *_ in parts)])
    return {
        "arm/parent": model.body_parentid.astype(np.int32),
        "arm/pos": model.body_pos.copy(),
        "arm/quat": model.body_quat.copy(),
        "arm/joint": np.array([[model.jnt_bodyid[j], names.index(model.joint(j).name)] for j in rows], np.int32),
        "arm/axis": model.jnt_axis[rows],
        "arm/anchor": model.jnt_pos[rows],
        "arm/zero": np.array([model.qpos0[model.jnt_qposadr[j]] for j in rows]),
        "arm/vertex": np.concatenate([v for v, *_ in parts]).astype(np.float32),
        "arm/face": np.concatenate([f + n for (_, f, *_), n in zip(parts, sizes, strict=False)]).astype(np.uint32),
        "arm/colour": np.concatenate([np.tile(c, (len(v), 1)) for v, _, _, c in parts]),
        "arm/body": np.concatenate([np.full(len(v), b, np.int32) for v, _, b, _ in parts]),
    }


def picked(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the arm's arrays among those of a file, KEY -> array; empty if one is missing."""
    return {k: arrays[f"arm/{k}"] for k in KEYS} if all(f"arm/{k}" in arrays for k in KEYS) else {}


def stage(arm: Mapping[str, np.ndarray]) -> dict[str, object]:
    """Return the data for the page's script: plain numbers, with vertices and faces as 16-bit integers in base64.

    Faces are sorted by body, so that each body is one range of faces: `parts` has (body, its first face, number of its
    faces). Vertices are integers times `scale`, m. A joint's `at` is its index in the result's `joints`.
    """
    order = np.argsort(arm["body"][arm["face"][:, 0].astype(int)], kind="stable")
    face = arm["face"][order].astype(int)
    scale = float(np.abs(arm["vertex"]).max()) / 32767 or 1.0
    bodies = arm["body"][face[:, 0]]
    return {
        "bodies": [
            {"parent": int(p), "pos": _short(x), "quat": _short(q)}
            for p, x, q in zip(arm["parent"], arm["pos"], arm["quat"], strict=True)
        ],
        "joints": [
            {"body": int(b), "at": int(i), "axis": _short(a), "anchor": _short(c), "zero": float(z)}
            for (b, i), a, c, z in zip(arm["joint"], arm["axis"], arm["anchor"], arm["zero"], strict=True)
        ],
        "parts": [[int(b), int(np.searchsorted(bodies, b)), int((bodies == b).sum())] for b in np.unique(bodies)],
        "scale": scale,
        "vertex": _text(np.round(arm["vertex"] / scale).astype("<i2")),
        "colour": _text(arm["colour"].astype(np.uint8)),
        "face": _text(face.astype("<u2")),
    }


def _turns(model: mujoco.MjModel, j: int) -> bool:
    """Say whether a joint is a hinge; the page's script moves no others."""
    return model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE


def _shapes(model: mujoco.MjModel) -> list[tuple[np.ndarray, np.ndarray, int, np.ndarray]]:
    """Return (vertices in the body, faces, body, colour) of drawn shapes except planes; [] from 2**16 vertices on.

    Links without shapes are capsules.
    """
    geoms = [g for g in visible(model) if model.geom_type[g] != mujoco.mjtGeom.mjGEOM_PLANE]
    shapes = [(g, shape) for g in geoms if (shape := shape_of(model, g)) is not None]
    total, out = sum(len(faces) for _, (_, faces) in shapes), []
    for g, shape in shapes:
        vertices, faces = simplified(*shape, max(FEWEST, int(FACES * len(shape[1]) / max(total, FACES))))
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[g])
        placed = vertices @ turn.reshape(3, 3).T + model.geom_pos[g]
        colour = np.round(255 * np.clip(colour_of(model, g), 0, 1)).astype(np.uint8)
        out.append((placed, faces, int(model.geom_bodyid[g]), colour))
    out += [(v, f, body, np.array(BARE[k % 2], np.uint8)) for k, (body, v, f) in enumerate(skeleton(model))]
    return out if sum(len(v) for v, *_ in out) < 2**16 else []  # the page's indices have 16 bits


def _short(values: np.ndarray) -> list[float]:
    """Round to 7 significant digits."""
    return [float(f"{v:.7g}") for v in values]


def _text(values: np.ndarray) -> str:
    """Encode an array's bytes in base64."""
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
