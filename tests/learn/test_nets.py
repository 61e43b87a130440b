"""Densities integrate to one, shifts only shift, targets follow."""

import numpy as np
import pytest
import torch
from torch import nn

from vispeg.learn.layout import Layout
from vispeg.learn.modalities import modality, names
from vispeg.learn.networks.actor import Actor
from vispeg.learn.networks.nets import Scale, random_shift, soft_update

KINDS = {"depth": (1, 24, 24), "rgb": (3, 24, 24)}


def actor_of(name, recurrent=0):
    torch.manual_seed(0)
    seen = modality(name)
    images = {f"{kind}_cam": KINDS[kind] for kind in seen.kinds}
    return Actor(Layout(5, images, 3, 22 * seen.knows, tuple(range(12, 17)) * seen.knows), seen, (32, 32), recurrent)


def observation(actor, n):
    images = {}
    for key, shape in actor.layout.images.items():
        noise = torch.rand(n, *shape)
        images[key] = (255 * noise).to(torch.uint8) if key.startswith("rgb") else noise
    return {**{key: torch.randn(n, length) for key, length in actor.layout.vectors.items()}, **images}


def test_density_of_one_squashed_action_integrates_to_one():
    """p(a) = N(atanh a) / (1 - a^2), summed over a grid, against the density that `sample` states."""
    torch.manual_seed(0)
    actor = Actor(Layout(5, {}, 1), modality("state"), (16,))
    latent = torch.randn(1, 16).expand(20_000, 16)
    action, log_prob = actor.sample(latent)
    mean, std = actor.mean(latent[:1]).item(), actor.log_std(latent[:1]).clamp(-10, 2).exp().item()
    grid = np.linspace(-1, 1, 200_001)[1:-1]
    density = np.exp(-0.5 * ((np.arctanh(grid) - mean) / std) ** 2) / (std * np.sqrt(2 * np.pi)) / (1 - grid**2)
    assert np.trapezoid(density, grid) == pytest.approx(1, abs=1e-3)
    found = np.interp(action[:, 0].detach().numpy(), grid, np.log(density))
    middle = np.abs(action[:, 0].detach().numpy()) < 0.999
    assert np.allclose(found[middle], log_prob.detach().numpy()[middle], atol=2e-3)


def test_density_stays_finite_where_the_action_saturates():
    actor = actor_of("state")
    with torch.no_grad():
        actor.mean.bias += 50.0
    _, log_prob = actor.sample(torch.zeros(8, 32))
    assert torch.isfinite(log_prob).all()


@pytest.mark.parametrize("name", [n for n in names()])
def test_every_modality_acts_within_bounds_and_sees_each_of_its_images(name):
    actor = actor_of(name)
    obs = observation(actor, 4)
    action, _ = actor.act(obs)
    assert action.shape == (4, 3) and action.abs().max() <= 1
    for key in actor.layout.keys:
        other = dict(obs) | {key: obs[key].flip(0)}
        assert not torch.equal(actor.act(other)[0], action), f"{name} does not look at {key}"


def test_no_reading_is_told_apart_from_a_near_surface_and_nan_is_no_reading():
    encoder = modality("depth").encoder("depth_cam", (1, 24, 24))
    none, near = torch.zeros(1, 1, 24, 24), torch.full((1, 1, 24, 24), 1e-4)
    assert not torch.allclose(encoder(none), encoder(near))
    assert torch.equal(encoder(none), encoder(none * torch.nan))


def test_depth_of_a_tenth_of_a_millimetre_reaches_the_features():
    """uint8 depth would round this away (1.6 mm a level)."""
    torch.manual_seed(0)
    encoder = modality("depth").encoder("depth_cam", (1, 24, 24))
    flat = torch.full((1, 1, 24, 24), 0.2)
    step = flat.clone()
    step[..., 12:] += 1e-4
    assert (encoder(flat) - encoder(step)).abs().max() > 1e-5


def test_a_shift_only_shifts():
    torch.manual_seed(0)
    image = torch.arange(36.0).reshape(1, 1, 6, 6).repeat(40, 1, 1, 1)
    moved = random_shift(image, 2)
    padded = nn.functional.pad(image[:1], (2, 2, 2, 2), mode="replicate")
    windows = [padded[0, 0, i : i + 6, j : j + 6] for i in range(5) for j in range(5)]
    seen = {next(k for k, w in enumerate(windows) if torch.equal(w, one[0])) for one in moved}
    assert len(seen) > 5
    assert torch.equal(random_shift(image, 0), image)


def test_target_moves_by_tau_of_the_way():
    a, b = nn.Linear(3, 2), nn.Linear(3, 2)
    before = a.weight.detach().clone()
    soft_update(a, b, 0.25)
    assert torch.allclose(a.weight, 0.75 * before + 0.25 * b.weight)


def test_scale_makes_samples_standard_and_leaves_constants_alone():
    scale, x = Scale(2), torch.stack([3 + 5 * torch.randn(5000), torch.full((5000,), 2.0)], 1)
    scale.measure(x)
    y = scale(x)
    assert y[:, 0].mean().abs() < 1e-4 and y[:, 0].std() == pytest.approx(1, abs=1e-2)
    assert (y[:, 1] == 0).all()


def test_memory_step_by_step_equals_memory_over_the_whole_sequence():
    actor = actor_of("state", recurrent=16)
    steps = torch.randn(7, 3, 5)
    whole, _ = actor.latent(steps)
    state, parts = actor.initial(3), []
    for one in steps:
        latent, state = actor.latent(one, state)
        parts.append(latent)
    assert torch.allclose(torch.stack(parts), whole, atol=1e-6)
