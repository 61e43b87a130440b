"""One table of image kinds: what is delivered, stored and shown follows from it; no other file tells kinds by name."""

import re
from pathlib import Path

import numpy as np
import pytest

from vispeg.core.frame import Frame
from vispeg.render.image_kinds import DEPTH, FAR, KINDS, MODES, RGB, camera_of, key_of, kind_of, picture_of


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_a_kind_delivers_stores_and_shows_what_it_says(kind):
    rng = np.random.default_rng(0)
    frame = Frame(
        rgb=rng.uniform(-0.2, 1.2, (3, 8, 9, 3)).astype(np.float32),
        depth=rng.uniform(0, 6, (3, 8, 9)).astype(np.float32),
        K=np.repeat(np.eye(3)[None], 3, axis=0),
    )
    images = kind.deliver(frame)
    assert images.shape == (3, *kind.shape(8, 9)) and images.dtype == kind.dtype
    assert images.min() >= 0 and images.max() <= kind.high
    packed = kind.pack(images)
    assert packed.dtype == kind.stored and kind.unpack(packed).dtype == kind.dtype
    inside = images <= 3.2 if kind is DEPTH else np.ones(images.shape, bool)
    assert np.abs(kind.unpack(packed).astype(float) - images)[inside].max() <= (2.6e-5 if kind is DEPTH else 0)
    shown = picture_of(key_of(kind, "eye"), images[0])
    assert shown.shape == (8, 9, 3) and shown.dtype == np.uint8 and shown.std() > 5
    assert kind.deliver(Frame(rgb=None, depth=None, K=frame.K)) is None


def test_keys_name_kind_and_camera():
    assert kind_of("depth_wrist_wide") is DEPTH and camera_of("depth_wrist_wide") == "wrist_wide"
    assert key_of(RGB, "external") == "rgb_external"
    assert kind_of("policy") is None and kind_of("privileged") is None and kind_of("depth") is None
    assert {kind for kinds in MODES.values() for kind in kinds} == set(KINDS.values())


def test_a_depth_picture_tells_near_from_far_and_from_no_reading():
    shown = picture_of("depth_eye", np.array([[[0.0, np.nan, 0.03, 0.39, FAR]]]))[0].astype(int)
    assert not shown[0].any() and not shown[1].any()
    assert shown[2][0] > shown[2][2] and shown[3][2] > shown[3][0], "near is red, far is blue"
    assert (shown[4] == shown[3]).all() or shown[4][2] >= shown[4][0]


def test_no_other_file_tells_kinds_by_their_names():
    package = Path(__file__).resolve().parents[2] / "vispeg"
    told = re.compile(r'startswith\(\(?"(depth|rgb)|removeprefix\("(depth|rgb)')
    assert not [p.name for p in package.rglob("*.py") if told.search(p.read_text())]
