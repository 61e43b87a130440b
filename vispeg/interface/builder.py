"""Build a policy's observations from a real robot's readings, and flange targets from its actions."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.frame import Frame
from vispeg.interface.interface import Interface
from vispeg.interface.terms import MEASURED, POLICY, policy_part, scaled
from vispeg.render.cameras.camera import Camera
from vispeg.render.image_kinds import KINDS, camera_of


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture that a camera took.

    Attributes:
        rgb: (H, W, 3) uint8 sRGB, or None.
        depth: (H, W) planar distance in m, 0 or NaN = no reading, or None.
        camera: the camera that took it, as calibrated; None if it is equal to the one that the policy knows.
    """

    rgb: np.ndarray | None = None
    depth: np.ndarray | None = None
    camera: Camera | None = None


class Builder:
    """The observations and actions of one episode of a policy on one arm.

    Args:
        interface: of the policy.
    """

    def __init__(self, interface: Interface):
        self.interface, self.observer = interface, interface.observer()
        self._recent: deque[np.ndarray] = deque(maxlen=interface.wrench_periods)
        self._begun = False

    def begin(self, q: np.ndarray, dq: np.ndarray, goal: np.ndarray | None = None) -> None:
        """Begin an episode.

        Args:
            q, dq: (nj,) measured joint angles and velocities, rad and rad/s.
            goal: (3,) m in the base, where the goal is believed to be; None for its nominal place. It is ignored for a
                policy that is not told the goal.
        """
        o, known = self.observer, self.interface.goal
        o.believed[0] = goal if goal is not None and known.told else known.nominal_m
        o.see(np.asarray(q, float)[None], np.asarray(dq, float)[None])
        o.begin(np.arange(1), o.flange)
        self._recent.clear()
        self._begun = False

    def feel(self, wrench: np.ndarray) -> None:
        """Store a reading of the wrist's sensor; call it once per control period.

        Args:
            wrench: (6,) N and N m, of the tool on the flange, in the flange's axes and about its origin, the tool's
                weight included.
        """
        self._recent.append(np.asarray(wrench, float))

    def observe(
        self, q: np.ndarray, dq: np.ndarray, pictures: Mapping[str, Picture] | None = None
    ) -> dict[str, np.ndarray]:
        """Return the policy's observation for the next step; each part has a leading axis of length 1.

        Args:
            q, dq: (nj,) measured joint angles and velocities, rad and rad/s.
            pictures: by camera's name.

        Raises:
            UserError: a picture is missing, has another size than its camera's, or lacks colour or depth.
        """
        o = self.observer
        o.see(np.asarray(q, float)[None], np.asarray(dq, float)[None])
        if self._begun and self._recent:
            o.feel(np.stack(self._recent)[:, None])
        values = scaled(self.interface.terms, o)
        if self._begun:
            o.stack.push(values)
        else:
            o.stack.fill(np.arange(1), values)
        self._begun = True
        measured = o.readings().astype(np.float32)
        return {POLICY: policy_part(o.stack), MEASURED: measured, **images(self.interface, pictures or {})}

    def act(self, action: np.ndarray) -> np.ndarray:
        """Return the flange pose (7,), m and w x y z in the base, that an action (d,) or (1, d) commands."""
        o = self.observer
        o.hold(*o.offset_by(o.asked(np.reshape(action, (1, -1)))))
        return np.concatenate([o.goal[0], o.rot[0]])


def images(interface: Interface, pictures: Mapping[str, Picture]) -> dict[str, np.ndarray]:
    """Return the image parts of an observation, (1, C, H, W) each. Raises UserError as `Builder.observe`."""
    out = {}
    for key, seen in interface.images.items():
        name, eye = camera_of(key), seen.eye
        if name not in pictures:
            raise UserError("no picture of a camera that the policy sees", key=name, got=sorted(pictures))
        picture = pictures[name]
        if picture.camera is not None and not _same(picture.camera, eye):
            picture = seen_by(eye, picture, picture.camera)
        shape = eye.height, eye.width
        for image in (picture.rgb, picture.depth):
            if image is not None and image.shape[:2] != shape:
                raise UserError("a picture of another size", key=name, expected=shape, got=image.shape[:2])
        rgb = None if picture.rgb is None else picture.rgb[None].astype(np.float32) / np.float32(255)
        depth = None if picture.depth is None else np.asarray(picture.depth, np.float32)[None]
        image = KINDS[seen.kind].deliver(Frame(rgb, depth, eye.K[None]))
        if image is None:
            raise UserError(f"a picture without {seen.kind}", key=name, expected=seen.unit)
        out[key] = image
    return out


def seen_by(eye: Camera, picture: Picture, camera: Camera) -> Picture:
    """Return the picture that the camera `eye`, in the place of `camera`, would have taken.

    It may differ in lens, size and field of view. Pixels outside the original picture are black, with depth 0.

    Args:
        eye: the camera whose picture is wanted.
        picture: taken by `camera`.
        camera: as calibrated.
    """
    import cv2

    at = camera.project(eye.rays()).astype(np.float32)  # (H, W, 2) px in the original picture, for each pixel of `eye`
    at = np.nan_to_num(at, nan=-1e6)  # outside the picture
    rgb, depth = picture.rgb, picture.depth
    return Picture(
        None if rgb is None else cv2.remap(rgb, at[..., 0], at[..., 1], cv2.INTER_LINEAR),
        # nearest neighbour: an interpolated depth between two surfaces would be wrong
        None if depth is None else cv2.remap(np.asarray(depth, np.float32), at[..., 0], at[..., 1], cv2.INTER_NEAREST),
    )


def _same(a: Camera, b: Camera) -> bool:
    return all(getattr(a, k) == getattr(b, k) for k in ("width", "height", "fx", "fy", "cx", "cy", "distortion"))
