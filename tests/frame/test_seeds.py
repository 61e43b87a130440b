"""Every seed that a user states, in a command, a script or a file, meets one check."""

import numpy as np
import pytest
import yaml

from vispeg.core.errors import UserError
from vispeg.core.seeds import LAST_SEED, check_seed, stream
from vispeg.datasets.shards.plan import Plan
from vispeg.formats.format import ENROLLED
from vispeg.task.environments.vector import TaskVec
from vispeg.trials.trial import FILE, NAME, read_said

BAD = (-1, LAST_SEED + 1, 10**30, 1.5, "1", None)


@pytest.mark.parametrize("seed", BAD)
def test_what_no_64_bit_integer_holds_is_no_seed(seed):
    with pytest.raises(UserError, match="seed: no such seed; expected a whole number from 0 to 2"):
        check_seed(seed)
    with pytest.raises(UserError, match="no such seed"):
        stream(seed, "name")
    with pytest.raises(UserError, match="no such seed"):
        Plan("S", "", 1, seed=seed)


def test_the_greatest_seed_and_numpys_own_integers_are_seeds():
    for seed in (0, LAST_SEED, np.int64(3), np.uint64(LAST_SEED)):
        check_seed(seed)
    assert stream(np.int64(3), "a").random() == stream(3, "a").random() != stream(LAST_SEED, "a").random()


@pytest.mark.parametrize("key", ["seed", "train_seed"])
@pytest.mark.parametrize("seed", [-1, 10**30])
def test_a_trial_with_an_impossible_seed_is_refused(tmp_path, key, seed):
    file = ENROLLED[NAME].example(tmp_path) / FILE
    said = yaml.safe_load(file.read_text())
    (said if key == "seed" else said["policy"])[key] = seed
    file.write_text(yaml.safe_dump(said))
    with pytest.raises(UserError, match=f"{key}: .*got {seed}"):
        read_said(file.parent)


@pytest.mark.parametrize("seed", [-1, LAST_SEED, 10**30])
def test_an_environment_whose_rows_count_up_beyond_the_last_seed_is_refused(seed):
    with pytest.raises(UserError, match="no such seed"):
        TaskVec(2, "S", seed=seed)
