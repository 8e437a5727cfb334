"""Campaigns for all tests."""

import pyarrow as pa
import pytest
import vre


@pytest.fixture(scope="session")
def folders(tmp_path_factory):
    made = []
    for seed in range(3):
        folder = tmp_path_factory.mktemp("campaigns") / str(seed)
        vre.simulate(folder, seed=seed, plan="remounted")
        made.append(folder)
    return made


@pytest.fixture(scope="session")
def batch(folders):
    return pa.record_batch({"number": [0, 1, 2], "campaign": pa.array(vre.arrow(folders))})
