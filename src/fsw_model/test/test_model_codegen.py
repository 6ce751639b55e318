"""Python code generated from CasADi does what CasADi does."""

import casadi as ca
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fsw_model import ProcessModel
from fsw_model.codegen import python_function

MODEL = ProcessModel()
STATES = st.tuples(
    st.floats(-0.5, 0.5),
    st.floats(-0.5, 0.5),
    st.floats(-1e-4, 1e-4),
    st.floats(-100.0, 100.0),
    st.floats(-100.0, 100.0),
    st.floats(500.0, 1500.0),
)
POWERS = st.tuples(*[st.floats(-20.0, 20.0)] * 4)


@given(STATES, POWERS, POWERS, st.floats(0.0, 120.0), st.floats(0.0, 600.0))
def test_step_and_outputs_equal_casadi(x, older, newer, force, speed):
    expected = [v for part in MODEL.step_function(list(x), older, newer, force, speed) for v in part.nonzeros()]
    generated = python_function(MODEL.step_function)(*x, *older, *newer, force, speed)
    assert generated == pytest.approx(expected, rel=1e-14, abs=1e-14)
    outputs = [float(value) for value in MODEL.output_function(list(x), force, speed)]
    assert python_function(MODEL.output_function)(*x, force, speed) == pytest.approx(outputs, rel=1e-14, abs=1e-14)


@given(st.floats(0.1, 5.0), st.floats(0.1, 5.0))
def test_every_supported_operation(a, b):
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    results = [x + y, x - y, x * y, x / y, -x, x * x, x + x, 1 / x, ca.sqrt(x), ca.exp(x), ca.log(x), ca.fabs(-x), x**y]
    function = ca.Function("f", [x, y], [ca.vertcat(*results, x**2.5, 3.0)])
    assert python_function(function)(a, b) == pytest.approx(function(a, b).nonzeros(), rel=1e-14)


def test_structural_zeros_and_matrix_order():
    x = ca.SX.sym("x", 2, 2)
    function = ca.Function("f", [x], [x.T, ca.SX(1, 1)])
    assert python_function(function)(1.0, 2.0, 3.0, 4.0) == (1.0, 3.0, 2.0, 4.0)


def test_unknown_operation_is_named():
    x = ca.SX.sym("x")
    with pytest.raises(ValueError, match=r"bent: CasADi operation .* has no Python counterpart"):
        python_function(ca.Function("bent", [x], [ca.erf(x)]))
