"""The commands as a user calls them: render, check, show; and mistakes, one line each."""

import re

import numpy as np
import pytest

from vispeg.cli.main import main
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
    page = (tmp_path / "d-page/index.html").read_text()
    assert "4 frames in 1 episode<" in page and "Contrast guard" in page and "wrist_crop" in page
    assert "in the worst, of all frames." in page and ">4 frames each<" in page
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


def test_ray_that_is_missing_is_one_line(monkeypatch):
    import sys

    from rendered import LAYOUT, PLAN, source

    from vispeg.core.errors import UserError
    from vispeg.datasets.shards.engine_ray import on_ray

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
