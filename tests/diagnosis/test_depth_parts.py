"""A depth camera's scale, offset and lean are told apart by distance; where they cannot be, they compete."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sensor_shots import CELL, LIT, WRIST, measured, shots

from vispeg.api.recording.look import scene_of
from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.findings import Verdict
from vispeg.diagnosis.pictures.parts import in_parts, smallest
from vispeg.diagnosis.pictures.sensors import Sensed, SensorSearch
from vispeg.diagnosis.pictures.spread import confirmed
from vispeg.diagnosis.pictures.verdict import with_sensor
from vispeg.identify.fit import Fit
from vispeg.identify.pictures.sensor import SensorEvidence, sensor_evidence
from vispeg.identify.space import Space
from vispeg.worlds.world import World

ADEQUATE = Verdict("adequate", "borders lie where they are predicted")


def seen(*hidden: EffectInstance, seed: int, flat: float = 0.0) -> SensorEvidence:
    """Depth with a tenth of a millimetre of noise through a sensor, of the cell or of a flat part at one distance."""
    sight, some = shots()
    rng, out = np.random.default_rng(seed), []
    for shot in some:
        seen = shot.rendering
        if flat:
            seen = replace(seen, depth=np.full_like(seen.depth, flat), parts=np.ones_like(seen.parts))
        shot = replace(shot, rendering=seen)
        _, depth = shot.sensed(CELL.add(*hidden), lambda k: True)
        noise = rng.normal(0, 1e-4, depth.shape) + rng.normal(0, 1e-4)
        out.append(replace(shot, depth=np.where(depth > 0, depth + noise, 0).astype(np.float32)))
    evidence = sensor_evidence(scene_of(CELL), [(sight, out)], "depth", LIT)
    assert evidence is not None
    return evidence


class OfBias(SensorSearch):
    """A search that does not look at noise and holes, which takes longer and finds none."""

    def places(self, world: World) -> list[tuple[str, str]]:
        return [at for at in super().places(world) if at[0] in ("depth_bias", "depth_scale")]


def found(*hidden: EffectInstance, flat: float = 0.0) -> Sensed:
    search = OfBias(*(seen(*hidden, seed=seed, flat=flat) for seed in (1, 2)))
    state = search.run(LIT)
    rivals = search.rivals(state)
    state, alike = in_parts(search, confirmed(search, state))
    return Sensed("depth", state, rivals, search.evidence, search.judged, LIT, [], search.shows_from(state), alike)


@pytest.mark.slow
def test_an_offset_is_no_scale_and_no_lean():
    result = found(EffectInstance.of("depth_bias", WRIST, offset=0.005))
    (named,) = result.added
    assert named.effect == "depth_bias" and not result.alike
    values = named.params
    assert values["offset"].value == pytest.approx(0.005, abs=3e-4)
    assert values["offset"].low < 0.005 < values["offset"].high
    assert all(values[k].value == 0 for k in ("scale", "tilt_x", "tilt_y", "ripple"))
    rungs, floor = result.ladder()
    assert [r["unit"] for r in rungs] == ["mm RMS"] * 2 and floor["unit"] == "mm RMS"
    assert rungs[0]["heldout_error"] == pytest.approx(5.0, abs=0.3) and rungs[1]["heldout_error"] < 0.5
    verdict = with_sensor(ADEQUATE, [result])
    assert verdict.verdict == "identified" and "held-out depth moved from 5.0 to" in verdict.reason


def test_at_one_distance_an_offset_and_a_scale_compete():
    result = found(EffectInstance.of("depth_bias", WRIST, offset=0.005), flat=0.22)
    assert result.alike and "offset" in result.alike[0] and "scale" in result.alike[0]
    assert with_sensor(ADEQUATE, [result]).verdict == "ambiguous"


@pytest.mark.slow
def test_a_scale_stays_a_scale():
    result = found(EffectInstance.of("depth_scale", WRIST, factor=1.02))
    (named,) = result.added
    assert named.effect == "depth_scale" and not result.alike


def fit_of(values: dict[str, float], covariance: np.ndarray) -> Fit:
    world = World().add(EffectInstance.of("depth_bias", WRIST, **values))
    space = Space(world, [0], measured("depth"))
    sigma = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sigma, sigma)
    return Fit(world, np.zeros(0), (np.zeros((0, len(sigma))),), space, space.start, sigma, correlation)


def test_the_smallest_sets_are_those_whose_rest_may_be_none():
    parts = effect("depth_bias").parts
    names = [n for part in parts for n in part]
    free = [a.name for a in fit_of({}, np.eye(5)).space.axes]
    assert sorted(free) == sorted(names)
    small = np.eye(5) * 0.01
    only = smallest(fit_of({"offset": 0.005}, small), 0, parts)
    assert only == [(("offset",),)]
    both = smallest(fit_of({"offset": 0.005, "scale": 0.02}, small), 0, parts)
    assert both == [(("scale",), ("offset",))]
    i, j = free.index("scale"), free.index("offset")
    ridge = small.copy()
    ridge[np.ix_([i, j], [i, j])] += 25 * np.outer([1, -0.9], [1, -0.9])
    either = smallest(fit_of({"offset": 0.0025, "scale": 0.01}, ridge), 0, parts)
    assert set(either) == {(("scale",),), (("offset",),)}
