"""The commands as a user calls them: render, check, show; and mistakes, one line each."""

import re

import numpy as np
import pytest

from vispeg.api.datasets import render_dataset
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.datasets.read import Dataset
from vispeg.report.dataset import build


def test_render_check_show_and_mistakes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    small = ["--world", "nominal", "--frames", "4", "--size", "16", "--workers", "0"]
    assert main(["render", *small, "--out", "d"]) == 0
    assert "4 frames of 2 cameras in d" in capsys.readouterr().out
    assert len(Dataset("d")) == 4
    assert main(["dataset", "check", "d"]) == 0 and "nothing wrong" in capsys.readouterr().out
    assert main(["dataset", "show", "d", "--tiles", "3"]) == 0
    monkeypatch.chdir(tmp_path / "d")
    assert main(["dataset", "show", ".", "--overwrite"]) == 0 and "d-page" in capsys.readouterr().out
    monkeypatch.chdir(tmp_path)
    page = (tmp_path / "d-page/index.html").read_text()
    assert "4 frames in 1 episode<" in page and "Contrast guard" in page and "wrist_crop" in page
    assert "in the worst, of all frames." in page and ">4 frames each<" in page
    assert "The only look was not." in page and "px, on the flange." in page
    monkeypatch.setattr(build, "SAMPLED", 3)
    assert "in the worst, of 3 frames looked at, spread over all 4." in build.render(
        Dataset("d"), np.zeros((8, 8, 3), np.uint8)
    )
    assert (tmp_path / "d-page/contact-sheet.png").stat().st_size > 1000
    assert not re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', page), "the page needs no file beside it"
    data = bytearray((tmp_path / "d/data/chunk-000/file-000.parquet").read_bytes())
    (tmp_path / "d/data/chunk-000/file-000.parquet").write_bytes(data[:-100])
    capsys.readouterr()
    assert main(["dataset", "check", "d"]) == 2
    assert "file-000.parquet: was cut short or changed" in capsys.readouterr().err
    for args, words in (
        (["render", *small, "--out", "d"], "not empty"),
        (["render", "--world", "nominall", "--out", "e"], "did you mean 'nominal'"),
        (["render", "--world", "nominal", "--frames", "0", "--out", "e"], "frames"),
        (["render", "--world", "nominal", "--looks", "2", "--out", "e"], "varies nothing that is seen"),
        (["render", "--world", "nominal", "--cameras", "wrist", "--out", "e"], "unknown camera"),
        (["dataset", "check", "d-page"], "is not a dataset"),
    ):
        assert main(args) == 2
        lines = capsys.readouterr().err.strip().splitlines()
        assert len(lines) == 1 and words in lines[0], lines
    assert sorted(p.name for p in tmp_path.iterdir()) == ["d", "d-page"]


@pytest.mark.parametrize(("option", "choices"), [("format", "lerobot, bop"), ("engine", "local, ray")])
def test_a_format_or_an_engine_that_there_is_not_is_refused_before_anything_is_written(tmp_path, option, choices):
    with pytest.raises(UserError, match=f"{option}: unknown {option}.*{choices}"):
        render_dataset(tmp_path / "d", "nominal", frames=4, **{option: "nosuch"})
    with pytest.raises(UserError, match="^size: .*8 to 1024 px; got 1$"):  # and not nominal.yaml, which states none
        render_dataset(tmp_path / "d", "nominal", frames=4, size=1)
    assert not list(tmp_path.iterdir())


def test_colour_alone_is_the_same_colour_and_every_command_reads_it(tmp_path, monkeypatch, capsys):
    """What LeRobot's loader would read slowly is not there; the rest is as it is beside depth."""
    monkeypatch.chdir(tmp_path)
    small = ["render", "--world", "nominal", "--frames", "4", "--size", "16", "--workers", "0"]
    assert main([*small, "--out", "both"]) == 0
    assert main([*small, "--modality", "rgb", "--no-labels", "--out", "rgb"]) == 0
    both, rgb = Dataset("both"), Dataset("rgb")
    left = {name for name in both.features if name not in rgb.features}
    assert left == {f"{kind}.{c}" for kind in ("observation.depth", "label.parts") for c in both.cameras}
    for name in rgb.features:
        assert np.array_equal(rgb.episode(0)[name], both.episode(0)[name]), name
    assert rgb.cameras == both.cameras
    assert main(["dataset", "check", "rgb"]) == 0 and main(["dataset", "show", "rgb", "--out", "page"]) == 0
    page = (tmp_path / "page" / "index.html").read_text()
    assert "colour of wrist_wide" in page and "depth of" not in page and "Depth is coloured" not in page
    capsys.readouterr()
    for args, said in (
        (["dataset", "export", "rgb", "--format", "bop", "--out", "bop"], "has no such depth, which BOP requires"),
        ([*small, "--modality", "rgb", "--format", "bop", "--out", "bop"], "BOP requires depth"),
    ):
        assert main(args) == 2
        err = capsys.readouterr().err.strip()
        assert said in err and "\n" not in err and not (tmp_path / "bop").exists()


def test_ray_that_is_missing_is_one_line(monkeypatch):
    import sys

    from rendered import LAYOUT, PLAN, source

    from vispeg.core.errors import UserError
    from vispeg.datasets.shards.engine import on_ray

    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(UserError, match=r"needs ray, of the extra 'cluster'.*pip install"):
        list(on_ray(PLAN.shards, source, PLAN, LAYOUT, 1, lambda frames: None))


@pytest.mark.parametrize(("address", "told"), [("", "0"), ("head:6379", None)])
def test_a_local_render_listens_on_loopback_unless_an_address_is_given(monkeypatch, address, told):
    import os
    import sys
    from types import SimpleNamespace

    from vispeg.core import cluster

    monkeypatch.setenv("RAY_ADDRESS", address)
    monkeypatch.setenv(cluster.CLUSTER, "")
    monkeypatch.delenv(cluster.CLUSTER)
    monkeypatch.setitem(sys.modules, "ray", SimpleNamespace())
    cluster._ray()
    assert os.environ.get(cluster.CLUSTER) == told
