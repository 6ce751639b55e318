"""What several tests of the NMPC share."""

import numpy as np
import pytest

from fsw_test_support.nmpc_problems import make_library
from fsw_test_support.ros_graph import domain_id

__all__ = ["domain_id"]


@pytest.fixture(scope="session", params=[20, 54])
def library(request):
    """A controller library with 20 blocks of ramps, or with a move in every interval."""
    return make_library(request.param)


@pytest.fixture(scope="session")
def library20():
    return make_library(20)


@pytest.fixture
def rng():
    return np.random.default_rng(7)
