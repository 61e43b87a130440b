"""Noise that a kind of depth camera has by nature is no effect, where the recording states the kind."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
import yaml
from sensor_shots import CELL, LIT, WRIST, shots

from vispeg.api.recording.look import scene_of
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.identify.pictures.read import _held
from vispeg.identify.pictures.sensor import sensor_evidence
from vispeg.recordings.frames.camera import RecordedCamera, Sensor, camera_entry, read_cameras
from vispeg.worlds.sensor import noise_of, sensors


def test_the_kinds_that_a_recording_may_state_are_the_sensors_there_are():
    assert set(get_args(Sensor)) == set(sensors())
    assert noise_of("d435") == pytest.approx(np.hypot(0.16, 0.1) / (337 * 0.05))


def test_cameras_yaml_states_the_kind(tmp_path):
    file = tmp_path / "cameras.yaml"
    camera = RecordedCamera("hand", 64, 48, 60.0, 60.0, 31.5, 23.5, sensor="d405")
    file.write_text(yaml.safe_dump({"hand": camera_entry(camera)}))
    cameras, unknown = read_cameras(file)
    assert cameras["hand"].sensor == "d405" and not unknown
    file.write_text(yaml.safe_dump({"hand": {**camera_entry(camera), "sensor": "d999"}}))
    with pytest.raises(UserError, match="hand.sensor"):
        read_cameras(file)


def test_a_frame_s_repeat_is_the_farthest_one_of_its_stretch_at_rest():
    q = np.zeros((9, 2))
    q[3:6] += 0.1
    q[6:, 1] += 0.2
    q[8] = np.nan
    same = np.zeros(9, int)
    assert [_held(q, same, row) for row in range(9)] == [2, 2, 0, 5, 5, 3, 7, 6, None]
    other = np.array([0, 0, 1, 1, 1, 1, 1, 1, 1])
    assert _held(q, other, 0) == 1 and _held(q, other, 2) is None


def test_what_a_d435_has_by_nature_is_odd_only_where_nobody_says_that_it_is_one():
    sight, some = shots()
    noise = EffectInstance.of("disparity_noise", WRIST, sd=0.16, length=1.0, focal=337.0, baseline=0.05)
    delivered = [shot.sensed(CELL.add(noise), lambda k: True) for shot in some]
    out = [replace(shot, depth=depth) for shot, (_, depth) in zip(some, delivered, strict=True)]
    odd = {}
    for kind in ("", "d435"):
        evidence = sensor_evidence(scene_of(CELL), [(replace(sight, sensor=kind), out)], "depth", LIT)
        assert evidence is not None
        odd[kind] = max(abs(v) for k, v in evidence.off(LIT).items() if k.startswith("scatter"))
    assert odd["d435"] < 0.8 < 1.5 < odd[""]
