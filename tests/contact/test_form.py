"""What of a squared residual is of form: closed form for white noise and for what lasts."""

import numpy as np
import pytest
from straight import blocks

from vispeg.contact.selection.form import form
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream


def test_white_noise_has_no_form():
    """Of n values of noise as much as chance makes: some sqrt(n) of n."""
    items = [blocks(np.repeat([0, 1, 2], 400)), blocks(np.zeros(300, int))]
    noise = 0.5 * stream(1, "white").standard_normal(6 * 1500)
    assert form(items, noise) < RULES.form_beside * 3 * np.sqrt(2 / len(noise)) * float(noise @ noise)


def test_a_residual_that_lasts_through_a_phase_is_an_error_of_form():
    """An offset c in one of two phases, beside noise: a share of n c^2. The step between phases is no noise."""
    items, c = [blocks(np.repeat([0, 1], 500))], 0.8
    lasting = np.zeros((1000, 6))
    lasting[500:, 2] = c
    noise = 0.3 * stream(2, "white").standard_normal((1000, 6))
    assert form(items, lasting.ravel()) == pytest.approx(RULES.form_beside * 500 * c**2)
    assert form(items, (lasting + noise).ravel()) == pytest.approx(RULES.form_beside * 500 * c**2, rel=0.2)


def test_blocks_that_are_not_compared_count_for_nothing():
    one = blocks(np.zeros(400, int), used=np.arange(400) < 200)
    residual = np.zeros((400, 6))
    residual[:200] = 0.4 * stream(3, "white").standard_normal((200, 6))
    assert form([one], residual.ravel()) < RULES.form_beside * 0.15 * float(np.sum(residual**2))
