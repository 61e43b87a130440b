"""What progress.csv says is what TensorBoard and Weights & Biases are told; a resumed run goes on as the same run."""

import csv
import json
import struct
import time

import pytest
from toy import Reach

from vispeg.learn.config import TrainConfig
from vispeg.learn.settings import SacSettings
from vispeg.learn.train import resume, train

SAC = SacSettings(batch=32, hidden=(16, 16), warmup=80, replay=600, horizon=12, utd=0.25)
CONFIG = TrainConfig("peg-state", steps=320, every=160, episodes=8, envs=8, sac=SAC)


def make(rows, settings):
    return Reach(rows, "state")


def rows(folder):
    with (folder / "progress.csv").open() as stream:
        return list(csv.DictReader(stream))


def test_tensorboard_has_the_rows_of_progress(tmp_path):
    reader = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    train(CONFIG, tmp_path / "run", make, show=False)
    events = reader.EventAccumulator(str(tmp_path / "run" / "tensorboard"))
    events.Reload()
    for name in ("success", "reward", "peak_force"):
        told = [(e.step, e.value) for e in events.Scalars(f"eval/{name}")]
        truth = [(int(row["steps"]), float(row[name])) for row in rows(tmp_path / "run")]
        assert [step for step, _ in told] == [step for step, _ in truth]
        assert [v for _, v in told] == pytest.approx([v for _, v in truth], rel=1e-4)
    assert not (tmp_path / "run" / "wandb").exists()


@pytest.mark.slow
def test_weights_and_biases_has_the_rows_of_progress_and_one_run_for_a_resumed_one(tmp_path, monkeypatch):
    pytest.importorskip("wandb")
    monkeypatch.setenv("WANDB_MODE", "offline")
    from dataclasses import replace

    folder = tmp_path / "run"
    train(replace(CONFIG, wandb="peg"), folder, make, show=False)
    resume(folder, 480, make, show=False)
    told, ids = history(folder)
    late = time.monotonic() + 30
    while 480 not in told and time.monotonic() < late:  # the library's own process writes the file
        time.sleep(0.2)
        told, ids = history(folder)
    truth = {int(row["steps"]): float(row["reward"]) for row in rows(folder)}
    assert sorted(truth) == [160, 320, 480]
    assert told == {step: pytest.approx(value, rel=1e-4) for step, value in truth.items()}
    assert ids == {json.loads((folder / "wandb.json").read_text())["id"]}


def history(folder):
    """Step -> mean return, and the ids of the runs, of what is kept offline."""
    from wandb.proto import wandb_internal_pb2

    told, ids = {}, set()
    for file in sorted((folder / "wandb").glob("offline-run-*/*.wandb")):
        for data in logged(file.read_bytes()):
            record = wandb_internal_pb2.Record()
            record.ParseFromString(data)
            if record.run.run_id:
                ids.add(record.run.run_id)
            items = {i.key or "/".join(i.nested_key): json.loads(i.value_json) for i in record.history.item}
            if "eval/reward" in items:
                told[items["steps"]] = items["eval/reward"]
    return told, ids


def logged(data):
    """The records of a LevelDB log: blocks of 32 kB, in them pieces with a checksum, a length and a kind before each.

    The first 7 bytes are the file's own mark (https://github.com/google/leveldb/blob/main/doc/log_format.md).
    """
    at, whole = 7, b""
    while at + 7 <= len(data):
        if 32768 - at % 32768 < 7:
            at += 32768 - at % 32768
            continue
        _, length, kind = struct.unpack_from("<IHB", data, at)
        whole += data[at + 7 : at + 7 + length]
        at += 7 + length
        if kind in (1, 4):  # whole, or its last piece
            yield whole
            whole = b""
