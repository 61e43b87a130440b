"""Plain shading for ray casting: ambient light plus Lambert's law, with material colours and textures."""

from __future__ import annotations

import mujoco
import numpy as np

from vispeg.render.backends.picture import colours
from vispeg.render.cameras.view import View

RGB = mujoco.mjtTextureRole.mjTEXROLE_RGB.value
DIRECTIONAL = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL.value
SPOT = mujoco.mjtLightType.mjLIGHT_SPOT.value
PLANE, BOX = mujoco.mjtGeom.mjGEOM_PLANE.value, mujoco.mjtGeom.mjGEOM_BOX.value
# Faces of OpenGL's cube map (OpenGL 4.6 specification, table 8.19): axis and sign of the face, then (axis, sign) of its
# texture coordinates s and t
FACES = ((0, 1, (2, -1), (1, -1)), (0, -1, (2, 1), (1, -1)), (1, 1, (0, 1), (2, 1)), (1, -1, (0, 1), (2, -1)))
FACES += ((2, 1, (0, 1), (1, -1)), (2, -1, (0, -1), (1, -1)))


def shade(
    model: mujoco.MjModel, data: mujoco.MjData, ids: np.ndarray, points: np.ndarray, normals: np.ndarray, view: View
) -> np.ndarray:
    """Return the colours (H, W, 3) uint8 of surface points, and of the sky where there is no hit.

    Args:
        model, data: the model and its state, with computed kinematics and lights.
        ids: (H, W) geom ids, -1 for no hit.
        points: (H, W, 3) in the world frame, m.
        normals: (H, W, 3) surface normals in the world frame.
        view: the view of the camera.
    """
    hit = ids >= 0
    out = np.empty((*ids.shape, 3))
    out[~hit] = _sky(model, (view.camera.rays() @ view.rot.T)[~hit])
    geoms, at, normal = ids[hit], points[hit], normals[hit]
    light = np.full(at.shape, model.vis.headlight.ambient[:3]) * bool(model.vis.headlight.active)
    to_eye = view.pos - at
    facing = np.sign(np.einsum("ij,ij->i", normal, to_eye))  # back faces are lit as front faces
    normal = normal * np.where(facing == 0, 1, facing)[:, None]
    if model.vis.headlight.active:
        light += _lambert(normal, to_eye)[:, None] * model.vis.headlight.diffuse[:3]
    for i in np.flatnonzero(model.light_active):
        pos, axis = data.light_xpos[i], data.light_xdir[i]
        towards = np.broadcast_to(-axis, at.shape) if model.light_type[i] == DIRECTIONAL else pos - at
        strength = _lambert(normal, towards)
        if model.light_type[i] == SPOT:
            aligned = -(towards @ axis) / np.maximum(np.linalg.norm(towards, axis=1), 1e-9)
            inside = aligned >= np.cos(np.radians(model.light_cutoff[i]))
            strength *= np.where(inside, np.maximum(aligned, 0) ** model.light_exponent[i], 0)
        light += model.light_ambient[i] + strength[:, None] * model.light_diffuse[i]
    out[hit] = _albedo(model, data, geoms, at, normal) * light
    return np.clip(np.rint(255 * out), 0, 255).astype(np.uint8)


def _lambert(normal: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Return the cosines (n,) of unit normals and directions to the light (n, 3); 0 for light from behind."""
    cosine = np.einsum("ij,ij->i", normal, towards) / np.maximum(np.linalg.norm(towards, axis=1), 1e-9)
    return np.maximum(cosine, 0)


def _albedo(
    model: mujoco.MjModel, data: mujoco.MjData, geoms: np.ndarray, at: np.ndarray, normal: np.ndarray
) -> np.ndarray:
    """Return the surface colours (n, 3): a geom's colour times its texture.

    The texture is projected along the geom axis that is nearest to the normal.
    """
    out = colours(model)[geoms, :3].astype(float)
    for geom in np.unique(geoms):
        texture = model.mat_texid[model.geom_matid[geom], RGB] if model.geom_matid[geom] >= 0 else -1
        if texture < 0 or model.tex_type[texture] != mujoco.mjtTexture.mjTEXTURE_2D.value:
            continue
        on, frame = geoms == geom, data.geom_xmat[geom].reshape(3, 3)
        local, face = (at[on] - data.geom_xpos[geom]) @ frame, np.abs(normal[on] @ frame).argmax(1)
        rows = np.arange(len(local))
        st = np.stack([local[rows, (face + 1) % 3], local[rows, (face + 2) % 3]], 1)
        st = (st + 0.5) * model.mat_texrepeat[model.geom_matid[geom]]  # texrepeat is in repeats per m
        image = _pixels(model, texture)
        v, u = ((st[:, ::-1] % 1) * image.shape[:2]).astype(int).T
        out[on] *= image[v, u] / 255
    return out


def _sky(model: mujoco.MjModel, directions: np.ndarray) -> np.ndarray:
    """Return the sky's colours (n, 3) in directions (n, 3), world frame; black if the model has no sky."""
    boxes = np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX.value)
    if not len(boxes) or not len(directions):
        return np.zeros((len(directions), 3))
    image = _pixels(model, int(boxes[0]))
    side = image.shape[1]
    xyz = np.stack([directions[:, 0], directions[:, 2], -directions[:, 1]], 1)  # from the world's z up to OpenGL's y up
    major, rows = np.abs(xyz).argmax(1), np.arange(len(xyz))
    face = 2 * major + (xyz[rows, major] < 0)
    out = np.empty((len(xyz), 3))
    for f, (axis, _, (s, s_sign), (t, t_sign)) in enumerate(FACES):
        on = face == f
        scale = 0.5 * side / np.abs(xyz[on, axis])
        u = np.clip(side / 2 + s_sign * xyz[on, s] * scale, 0, side - 1).astype(int)
        v = np.clip(side / 2 + t_sign * xyz[on, t] * scale, 0, side - 1).astype(int)
        out[on] = image[f * side + v, u] / 255
    return out


def _pixels(model: mujoco.MjModel, texture: int) -> np.ndarray:
    """Return a view (h, w, 3) uint8 of a texture's pixels."""
    shape = int(model.tex_height[texture]), int(model.tex_width[texture]), int(model.tex_nchannel[texture])
    start = int(model.tex_adr[texture])
    return model.tex_data[start : start + int(np.prod(shape))].reshape(shape)[..., :3]
