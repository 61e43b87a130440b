"""A board in the cell: drawn, found and laid down where closed-form projection has it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from border_points import seen
from scipy.spatial.transform import Rotation

from vispeg.core.errors import UserError
from vispeg.diagnosis.pictures.flatness import heights_left, heights_of_views, judge_heights
from vispeg.recordings.cell import CellBelief
from vispeg.render.calibration.board import Board
from vispeg.render.calibration.detect import View
from vispeg.render.cameras.camera import Camera
from vispeg.vision.board import Look, board_of, laid, view_of_board
from vispeg.vision.board_picture import texture, with_board
from vispeg.vision.eye import Eye
from vispeg.worlds.world import World

STATED = {"kind": "chessboard", "columns": 5, "rows": 4, "square": 0.02}
BOARD = Board(**STATED)
CAMERA = Camera("eye", 320, 240, 300.0, 300.0, 159.5, 119.5)
EYE = Eye(CAMERA, CAMERA, (0.05, 0.0, 0.0, 0.0, 0.0))
POSE = np.eye(4)
POSE[:3, :3], POSE[:3, 3] = Rotation.from_euler("xyz", [np.pi - 0.05, 0.03, 0.4]).as_matrix(), (0.46, 0.1, 0.01)


def views(bend=0.0, noise=0.0, seed=0, count=8):
    """(place, axes) and corners (n, 2) px of views from about 0.3 m, the board's middle standing out by `bend` m."""
    rng = np.random.default_rng(seed)
    points = BOARD.points.copy()
    points[:, 2] = -bend * (1 - ((points[:, 0] - 0.04) / 0.04) ** 2)
    middle = POSE[:3, :3] @ [0.04, 0.03, 0.0] + POSE[:3, 3]
    out = []
    for k in range(count):
        turn = POSE[:3, :3] @ Rotation.from_euler("zx", [2.0 * k, 0.5 if k % 2 else 0.2]).as_matrix()
        pos = middle - rng.uniform(0.22, 0.32) * turn[:, 2]
        base = points @ POSE[:3, :3].T + POSE[:3, 3]
        pixel = EYE.project((base - pos) @ turn) + noise * rng.normal(size=(len(points), 2))
        out.append((pos, turn, pixel))
    return out


def look(pos, turn, pixel):
    return Look(pos, turn, View("", (320, 240), np.arange(len(pixel)), pixel))


def test_corners_of_a_drawn_board_are_found_where_they_project():
    for pos, turn, pixel in views(count=4):
        grey, far = np.full((240, 320, 3), 120, np.uint8), np.full((240, 320), 2.0)
        rgb, depth = with_board(grey, far, EYE, (pos, turn), BOARD, POSE)
        found = view_of_board(rgb, BOARD)
        assert found is not None and len(found.ids) == 20
        away = found.pixels - pixel[found.ids]
        assert np.sqrt(np.mean(away**2)) < 0.15 and np.abs(away.mean(axis=0)).max() < 0.05
        u, v = np.rint(pixel.mean(axis=0)).astype(int)
        ray = turn @ EYE.rays()[v, u]
        normal = POSE[:3, 2]
        assert depth[v, u] == pytest.approx(normal @ (POSE[:3, 3] - pos) / (normal @ ray), abs=1e-5)


def test_what_stands_before_a_board_hides_it():
    (pos, turn, _), *_ = views()
    near = np.full((240, 320), 0.1)
    rgb, depth = with_board(np.full((240, 320, 3), 120, np.uint8), near, EYE, (pos, turn), BOARD, POSE)
    assert (rgb == 120).all() and (depth == np.float32(0.1)).all()


def test_a_board_is_laid_down_where_it_lies_by_corners_that_one_view_in_six_has_wrong():
    some = [look(*v) for v in views(count=6)]
    some[2] = replace(some[2], view=replace(some[2].view, pixels=some[2].view.pixels + [40.0, 0.0]))
    places = laid(EYE, BOARD, some)
    assert places == pytest.approx(BOARD.points @ POSE[:3, :3].T + POSE[:3, 3], abs=3e-4)
    assert laid(EYE, BOARD, []) is None


@pytest.mark.parametrize("bend", [0.0, 0.003])
def test_heights_of_a_bent_board_are_found_whatever_the_arm_makes_of_each_view(bend):
    stacked = []
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        looks = []
        for pos, turn, pixel in views(bend, 0.05, seed):
            shift, rotated = 3e-3 * rng.normal(size=3), Rotation.from_rotvec(0.02 * rng.normal(size=3)).as_matrix()
            looks.append(look(pos + shift, rotated @ turn, pixel))  # where a wrong arm believes the camera
        stacked.append(heights_of_views(EYE, BOARD, looks))
    left = judge_heights(*stacked[0], *stacked[1])
    assert (left.share > 0.5 and left.size > 0.2) if bend else (left.share < 0.1 and left.size < 0.1)


def test_heights_are_those_of_one_board_in_fitted_and_held_out_views():
    geometry, sight = seen((320, 240))
    eye = geometry.eyes[sight.camera.name]

    def of(board):
        points = board.points - board.points.mean(axis=0) + [0.0, 0.0, 0.3]  # upright before the camera
        view = View("", (320, 240), np.arange(len(points)), eye.project(points))
        return replace(sight, board=board, corners=lambda i: view)

    bigger = replace(BOARD, columns=7, rows=6)
    (left,) = heights_left(geometry, [of(BOARD)], [of(BOARD)], World())
    assert left.share < 0.1
    assert not heights_left(geometry, [of(BOARD)], [of(bigger)], World())
    assert not heights_left(geometry, [of(BOARD)], [of(BOARD), of(replace(BOARD, square=0.015))], World())
    assert not heights_left(geometry, [of(BOARD)], [sight], World())


def test_a_cell_states_its_board_and_a_board_that_cannot_be_is_named():
    assert board_of(CellBelief("nominal", board=STATED)) == BOARD
    assert board_of(None) is None and board_of(CellBelief("nominal")) is None
    assert CellBelief("nominal", board=STATED).plain() == {"world": "nominal", "board": STATED}
    for wrong in ({**STATED, "columns": 4}, {"kind": "charuco", "columns": 5, "rows": 4, "square": 0.02}):
        with pytest.raises(UserError) as error:
            board_of(CellBelief("nominal", board=wrong), Path("rig/recording.yaml"))
        assert "cell.board" in str(error.value) and "recording.yaml" in str(error.value)
    for change, said in (
        ({"columns": 0}, "rig.yaml: cell.board.columns, rows: no such pattern; expected 3x3 to 100x100; got '0x4'"),
        ({"square": 2.0}, "rig.yaml: cell.board.square: impossible size of a square; expected 0.0001 to 1 m; got 2.0"),
    ):
        with pytest.raises(UserError) as error:
            board_of(CellBelief("nominal", board={**STATED, **change}), Path("rig.yaml"))
        assert str(error.value) == said


@pytest.mark.parametrize(("columns", "rows"), [(7, 5), (5, 7), (6, 4), (7, 6), (6, 7)])
def test_a_board_is_refused_whose_print_is_the_same_after_half_a_turn(columns, rows):
    """Its corners would be numbered from the other end where the camera has rolled: 65 px off at 7 x 5."""
    stated = STATED | {"columns": columns, "rows": rows}
    cell, printed = CellBelief("nominal", board=stated), texture(Board(**stated))
    if np.array_equal(printed, np.rot90(printed, 2)):
        with pytest.raises(
            UserError, match=f"rig.yaml: cell.board: looks the same after half .*got '{columns}x{rows}'"
        ):
            board_of(cell, Path("rig.yaml"))
    else:
        assert board_of(cell) == Board(**stated)
