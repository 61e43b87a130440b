"""Corners are found where the pinhole equation has them, in one order, and a wrong board is said in a line."""

import os

import cv2
import numpy as np
import pytest
from board_views import BOARD, CHARUCO, ideal, picture, place

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.effects.common import images
from vispeg.render.calibration import Board, detect
from vispeg.render.calibration.board import parse_pattern
from vispeg.render.calibration.detect import find, pictures


@pytest.mark.parametrize("board", [BOARD, CHARUCO], ids=["chessboard", "charuco"])
def test_corners_lie_where_the_board_is(board):
    rng = stream(1, "detect", board.kind)
    for _ in range(3):
        at = place(rng, board)
        view = find(picture(board, at), board)
        assert view is not None and view.size == (640, 480)
        off = np.linalg.norm(view.pixels - ideal(board, at)[view.ids], axis=1)
        assert np.sqrt(np.mean(off**2)) < 0.1 and off.max() < 0.4
        assert len(view.ids) == len(board.points) if board.kind == "chessboard" else len(view.ids) > 25


def test_the_first_corner_stays_first_however_the_board_is_turned():
    at = place(stream(2, "order"))
    image = picture(BOARD, at)
    upright = find(image, BOARD)
    for quarter in (1, 2, 3):
        turned = find(np.ascontiguousarray(np.rot90(image, quarter)), BOARD)
        assert upright is not None and turned is not None
        x, y = upright.pixels.T
        for _ in range(quarter):  # np.rot90: counter-clockwise, (x, y) -> (y, width - 1 - x)
            width = 640 if _ % 2 == 0 else 480
            x, y = y, width - 1 - x
        assert np.abs(turned.pixels - np.stack([x, y], axis=1)).max() < 0.1


def test_large_images_are_refined_at_their_own_size():
    at = place(stream(5, "large"))
    image, times = picture(BOARD, at), 5
    large = find(cv2.resize(image, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC), BOARD)
    assert large is not None
    off = (large.pixels + 0.5) / times - 0.5 - ideal(BOARD, at)
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.2  # px of the image before it was enlarged, and blurred so


def test_charuco_in_part():
    at = place(stream(3, "part"), CHARUCO)
    image = picture(CHARUCO, at)
    whole = find(image, CHARUCO)
    assert whole is not None
    left = int(np.median(whole.pixels[:, 0]))
    image[:, :left] = 128
    part = find(image, CHARUCO)
    assert part is not None and 6 <= len(part.ids) < len(whole.ids)
    assert np.abs(part.pixels - ideal(CHARUCO, at)[part.ids]).max() < 0.4


def test_mistakes(tmp_path):
    image = picture(BOARD, place(stream(4, "mistakes")))
    cv2.imwrite(str(tmp_path / "10.png"), image)
    cv2.imwrite(str(tmp_path / "2.png"), image)
    assert [p.name for p in pictures(tmp_path)] == ["2.png", "10.png"]
    views, missed = detect(tmp_path, BOARD)
    assert len(views) == 1 and missed == {"10.png": "repeats 2.png"}
    with pytest.raises(UserError, match="no 10x7 chessboard found in any of 2.*9x6 inner corners.*not squares"):
        detect(tmp_path, Board("chessboard", 10, 7, 0.02))
    cv2.imwrite(str(tmp_path / "3.png"), np.full((480, 640), 128, np.uint8))
    assert detect(tmp_path, BOARD)[1]["3.png"] == "board not found"
    cv2.imwrite(str(tmp_path / "4.png"), image[:400])
    with pytest.raises(UserError, match="another size.*640x480.*640x400"):
        detect(tmp_path, BOARD)
    (tmp_path / "1.png").write_bytes(b"no picture")
    with pytest.raises(UserError, match="cannot be read as an image"):
        detect(tmp_path, BOARD)
    with pytest.raises(UserError, match="does not exist"):
        detect(tmp_path / "gone", BOARD)
    with pytest.raises(UserError, match="1.png: is no folder"):
        detect(tmp_path / "1.png", BOARD)
    (tmp_path / "empty").mkdir()
    with pytest.raises(UserError, match="no image here"):
        detect(tmp_path / "empty", BOARD)


@pytest.mark.parametrize("flip", [0, 1])
def test_a_mirrored_charuco_is_refused_as_that(tmp_path, flip):
    """Its markers are none of the dictionary; a chessboard's mirror image is told by the robot's motion alone."""
    rng = stream(6, "mirrored")
    cv2.imwrite(str(tmp_path / "0.png"), np.full((480, 640), 128, np.uint8))  # the first need not show the board
    for number in (1, 2):
        cv2.imwrite(str(tmp_path / f"{number}.png"), cv2.flip(picture(CHARUCO, place(rng, CHARUCO)), flip))
    with pytest.raises(UserError, match="no 8x6 charuco found in any of 3.*it is there mirrored"):
        detect(tmp_path, CHARUCO)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (("chessboard", 9, 9, 0.02), "no definite orientation"),
        (("chessboard", 2, 9, 0.02), "no such pattern"),
        (("chessboard", 9, 6, 23.6), "0.0001 to 1 m"),
        (("charuco", 9, 6, 0.02, 0.03, "DICT_4X4_50"), "marker"),
        (("charuco", 9, 6, 0.02, 0.01, "DICT_4X4_5"), "did you mean"),
        (("charuco", 20, 16, 0.02, 0.01, "DICT_4X4_50"), "fewer markers"),
        (("tag", 9, 6, 0.02, 0.0, "DICT_APRILTAG_36h11"), "a tag has no pattern"),
        (("circles", 9, 6, 0.02), "choices: chessboard, charuco"),
    ],
)
def test_no_such_board(values, words):
    with pytest.raises(UserError, match=words):
        Board(*values)


def test_pattern_text():
    assert parse_pattern("9x6") == (9, 6)
    for text in ("9", "9,6", "9x6x2", "axb"):
        with pytest.raises(UserError, match="COLUMNSxROWS"):
            parse_pattern(text)


@pytest.mark.parametrize("special", [os.mkfifo, lambda p: p.symlink_to("/dev/zero")])
def test_a_pipe_or_a_device_among_the_images_is_refused_before_it_is_opened(tmp_path, special):
    special(tmp_path / "1.png")
    with pytest.raises(UserError, match=r"1\.png: is not a regular file"):
        detect(tmp_path, BOARD)
    for read in (images.picture, images.environment):  # of a texture
        with pytest.raises(UserError, match="is not a regular file"):
            read(tmp_path / "1.png", 8)
