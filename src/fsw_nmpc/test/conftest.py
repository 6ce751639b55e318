"""Problems and solvers that several tests of the NMPC share."""

import numpy as np
import pytest

from fsw_model import nominal
from fsw_nmpc import kernel_build
from fsw_nmpc.horizon import horizon_of
from fsw_nmpc.solvers.casadi_qp import CasadiSolver
from fsw_nmpc.solvers.rti import RtiSolver

PARAMETERS = nominal()


@pytest.fixture(scope="session")
def library():
    if kernel_build.find() is None and kernel_build.compiler() is None:
        pytest.skip("the kernel is not built and there is no C compiler")
    return kernel_build.ensure()


@pytest.fixture(scope="session", params=[20, 54])
def rti(request, library):
    return RtiSolver(PARAMETERS, horizon_of(PARAMETERS, request.param), library, max_iterations=100)


@pytest.fixture(scope="session", params=[20, 54])
def fallback(request):
    return CasadiSolver(PARAMETERS, horizon_of(PARAMETERS, request.param), max_iterations=100)


@pytest.fixture
def rng():
    return np.random.default_rng(7)
