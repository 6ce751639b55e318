"""acados' SQP-RTI by its C interface.

The problem of a tick by a stage per block, condensed and solved by HPIPM or qpOASES.

Linearised about the same plan it is the library's QP, so it has the same solution. CasADi writes
the stages' functions as C code. acados comes as a wheel that also has a CasADi of its own; it is
installed apart, so that it does not replace the real one. A process must not load the HPIPM of
CasADi as well.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import casadi as ca
import cffi
import numpy as np

from fsw_control.c_library import needed_compiler, run_compiler
from fsw_model import ModelParameters
from fsw_nmpc.library import KERNEL, Library, SolveStatus, Vector
from fsw_test_support.nmpc_problems import predict
from fsw_test_support.nmpc_stages import INPUTS, Stage, StageData, Stages

LOCK = Path(__file__).resolve().parents[3] / "requirements" / "acados.lock"
#: of acados_c/ocp_nlp_interface.h and external_function_interface.h, as far as used
_DECLARATIONS = """
typedef struct { int qp_solver; } qp_plan;
typedef struct {
  qp_plan ocp_qp_solver_plan;
  int *sim_solver_plan;
  int nlp_solver, regularization;
  int *nlp_cost, *nlp_dynamics, *nlp_constraints;
  int N;
} ocp_nlp_plan_t;
typedef struct { void *config, *dims, *opts, *mem, *work; } ocp_nlp_solver;
ocp_nlp_plan_t *ocp_nlp_plan_create(int n);
void *ocp_nlp_config_create(ocp_nlp_plan_t plan);
void *ocp_nlp_dims_create(void *config);
void ocp_nlp_dims_set_opt_vars(void *config, void *dims, const char *field, const void *values);
void ocp_nlp_dims_set_constraints(void *config, void *dims, int stage, const char *field, const void *value);
void ocp_nlp_dims_set_cost(void *config, void *dims, int stage, const char *field, const void *value);
void *ocp_nlp_in_create(void *config, void *dims);
void *ocp_nlp_out_create(void *config, void *dims);
void ocp_nlp_in_set(void *config, void *dims, void *in, int stage, const char *field, void *value);
int ocp_nlp_dynamics_model_set(void *config, void *dims, void *in, int stage, const char *field, void *value);
int ocp_nlp_cost_model_set(void *config, void *dims, void *in, int stage, const char *field, void *value);
int ocp_nlp_constraints_model_set(void *config, void *dims, void *in, int stage, const char *field, void *value);
void ocp_nlp_out_set(void *config, void *dims, void *out, int stage, const char *field, void *value);
void ocp_nlp_out_get(void *config, void *dims, void *out, int stage, const char *field, void *value);
void *ocp_nlp_solver_opts_create(void *config, void *dims);
void ocp_nlp_solver_opts_set(void *config, void *opts, const char *field, void *value);
ocp_nlp_solver *ocp_nlp_solver_create(void *config, void *dims, void *opts);
int ocp_nlp_precompute(ocp_nlp_solver *solver, void *in, void *out);
int ocp_nlp_solve(ocp_nlp_solver *solver, void *in, void *out);
void ocp_nlp_get(void *config, ocp_nlp_solver *solver, const char *field, void *value);

typedef struct {
  void *evaluate, *get_nparam;
  void (*set_param)(void *, double *);
  void *set_param_sparse, *memory;
  void *casadi[6];       /* the function, its work, sparsity in and out, n_in, n_out */
  void *args, *res, *w, *iw, *args_size, *res_size;
  int numbers[9];
} external_function_param_casadi;
void external_function_param_casadi_create(external_function_param_casadi *function, int np);
"""
#: what CasADi's code adds to the name of a function
_SUFFIXES = ("", "_work", "_sparsity_in", "_sparsity_out", "_n_in", "_n_out")
#: functions of a stage, and what acados calls them
_FIELDS = {
    "step": "disc_dyn_fun",
    "step_jacobian": "disc_dyn_fun_jac",
    "shown": "nls_y_fun",
    "shown_jacobian": "nls_y_fun_jac",
}
#: values of the interface's enumerations
QP_SOLVERS = {
    "partial condensing, HPIPM": 0,
    "full condensing, HPIPM": 5,
    "full condensing, qpOASES": 6,
}
_SQP_RTI, _DISCRETE, _LINEAR_LS, _NONLINEAR_LS, _NO_INTEGRATOR = 1, 1, 0, 1, 4
_PREPARATION, _FEEDBACK = 1, 2
_TOLERANCE, _LONGEST_ITERATIONS = 1e-6, 100
#: as in the library: the largest start, in largest moves
_INSIDE = 0.95


def install() -> Path | str:
    """Folder of acados' libraries, installed into the environment at first use.

    Where that cannot be, the reason.
    """
    processor = Path("/proc/cpuinfo")
    if platform.machine() != "x86_64" or not processor.is_file():
        return "acados' wheel is for Linux on x86-64"
    if " avx2 " not in processor.read_text(encoding="utf-8"):
        return "acados' wheel needs a processor with AVX2"
    wanted = LOCK.read_text(encoding="utf-8").splitlines()[-1]
    home = Path(sys.prefix) / "tools" / wanted
    if not home.is_dir():
        scratch = home.with_name(f"{home.name}.{os.getpid()}")
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
        options = ["--no-deps", "--only-binary", ":all:", "--target", str(scratch), wanted]
        run = subprocess.run([*pip, *options], capture_output=True, text=True, check=False)
        if run.returncode:
            return f"cannot install {wanted}: {run.stderr.strip().splitlines()[-1]}"
        scratch.replace(home)
    return home / "acados" / "install" / "lib"


class Acados:
    """acados' libraries, in the order in which they need each other."""

    def __init__(self, folder: Path) -> None:
        self.ffi = cffi.FFI()
        self.ffi.cdef(_DECLARATIONS)
        names = ("libblasfeo", "libhpipm", "libqpOASES_e", "libacados")
        *self._needed, self.lib = (self.ffi.dlopen(str(folder / f"{name}.so")) for name in names)

    def compiled(self, stages: Stages, optimisation: str = "-O2") -> Any:
        """The functions of all stages and their Jacobians as a library of compiled C."""
        code = ca.CodeGenerator("stages", {"casadi_int": "int", "casadi_real": "double"})
        functions = [
            function for k, stage in enumerate(stages.stages) for function in _functions(k, stage)
        ]
        for function in functions:
            code.add(function)
        with tempfile.TemporaryDirectory() as folder:
            code.generate(f"{folder}/")
            options = (optimisation, "-march=native", "-fPIC", "-shared", "-w")
            files = (f"{folder}/stages.c", "-o", f"{folder}/stages.so", "-lm")
            run_compiler([*needed_compiler(), *options, *files])
            self.ffi.cdef(
                "".join(
                    f"void {function.name()}{suffix}();"
                    for function in functions
                    for suffix in _SUFFIXES
                ),
                override=True,
            )
            return self.ffi.dlopen(f"{folder}/stages.so")


def _functions(k: int, stage: Stage) -> list[ca.Function]:
    """The functions that acados calls for stage ``k``."""
    x, u, p = (ca.SX.sym(name, stage.step.size1_in(i)) for i, name in enumerate("xup"))
    none, free = ca.SX.sym("z", 0), ca.vertcat(u, x)
    after, shown = stage.step(x, u, p), ca.vertcat(stage.outputs(x, u, p), u)
    by_none = ca.SX(shown.size1(), 0)
    return [
        ca.Function(f"step_{k}", [x, u, p], [after]),
        ca.Function(f"step_jacobian_{k}", [x, u, p], [after, ca.jacobian(after, free).T]),
        ca.Function(f"shown_{k}", [x, u, none, p], [shown]),
        ca.Function(
            f"shown_jacobian_{k}",
            [x, u, none, p],
            [shown, ca.jacobian(shown, free).T, by_none],
        ),
    ]


class AcadosSolver:
    """Solves the problem of a tick by one SQP-RTI of acados about the last plan, as the library does.

    Parameters
    ----------
    acados : Acados
    compiled : library of cffi
        ``acados.compiled`` of the same horizon.
    library : Library
        Its horizon, and its tuning at the time of making the solver. Costs are quadratic (preset
        ``default``).
    parameters : ModelParameters
    qp_solver : str
        Name in ``QP_SOLVERS``.
    blocks : int
        Stages of the QP after partial condensing.
    """

    name = "acados"

    def __init__(
        self,
        acados: Acados,
        compiled: Any,
        library: Library,
        parameters: ModelParameters,
        qp_solver: str = "full condensing, HPIPM",
        blocks: int = 0,
    ) -> None:
        self._ffi, self._lib, self._library = acados.ffi, acados.lib, library
        self._stages = Stages(library, parameters)
        self.preparation_s: list[float] = []  #: CPU time of every solve
        self.feedback_s: list[float] = []
        self._config = self._lib.ocp_nlp_config_create(self._plan(qp_solver)[0])
        self._dims = self._lib.ocp_nlp_dims_create(self._config)
        self._set_dimensions()
        self._at = self._config, self._dims
        self._in = self._lib.ocp_nlp_in_create(*self._at)
        self._out = self._lib.ocp_nlp_out_create(*self._at)
        self._functions = self._connected(compiled)
        self._set_constants()
        self._opts = self._lib.ocp_nlp_solver_opts_create(*self._at)
        for field in ("exact_hess", "qp_iter_max"):
            self._option(field, "int", 0 if field == "exact_hess" else _LONGEST_ITERATIONS)
        if blocks:
            self._option("qp_cond_N", "int", blocks)
        if "HPIPM" in qp_solver:  # the fastest settings found
            self._option("qp_hpipm_mode", "char[]", b"SPEED")
            self._option("qp_warm_start", "int", 1)
            for what in ("stat", "eq", "ineq", "comp"):
                self._option(f"qp_tol_{what}", "double", _TOLERANCE)
        self._solver = self._lib.ocp_nlp_solver_create(*self._at, self._opts)
        if self._lib.ocp_nlp_precompute(self._solver, self._in, self._out):
            raise RuntimeError("acados refuses the problem")

    def solve(self, problem: Any, moves: Vector) -> tuple[int, Vector, Vector, Vector]:
        """One iteration about ``moves`` (2 n_blocks,).

        Status, moves, and their outputs in the linear model.
        """
        h, data = self._library.horizon, self._stages.data(problem)
        inputs = np.clip(self._stages.inputs(moves), -_INSIDE, _INSIDE)
        states = self._stages.rolled_out(self._stages.start(problem), inputs, data)
        self._give(states, inputs, data)
        status = 0
        for phase, times in ((_PREPARATION, self.preparation_s), (_FEEDBACK, self.feedback_s)):
            self._option("rti_phase", "int", phase)
            began = time.thread_time()
            status = self._lib.ocp_nlp_solve(self._solver, self._in, self._out)
            times.append(time.thread_time() - began)
        blocks = np.array([self._taken(k) for k in range(h.n_blocks)])
        if status or not np.isfinite(blocks).all():
            nothing = np.full(h.n_out, np.nan)
            return SolveStatus.NOT_SOLVED, moves, nothing, nothing
        best, about = self._stages.moves(blocks), self._stages.moves(inputs)
        start = KERNEL.ffi.addressof(problem, "start")
        depth, temperature, by_depth, by_temperature = predict(self._library, start, about)
        change = best - about
        return (
            SolveStatus.OK,
            best,
            depth + by_depth @ change,
            temperature + by_temperature @ change,
        )

    def _plan(self, qp_solver: str) -> Any:
        n = len(self._stages.stages)
        plan = self._lib.ocp_nlp_plan_create(n)
        plan.ocp_qp_solver_plan.qp_solver, plan.nlp_solver = QP_SOLVERS[qp_solver], _SQP_RTI
        plan.regularization = 0
        for k in range(n + 1):
            plan.nlp_cost[k], plan.nlp_constraints[k] = _LINEAR_LS if k == n else _NONLINEAR_LS, 0
        for k in range(n):
            plan.nlp_dynamics[k], plan.sim_solver_plan[k] = _DISCRETE, _NO_INTEGRATOR
        return plan

    def _set_dimensions(self) -> None:
        stages = self._stages.stages
        n, states = len(stages), [stage.n_states for stage in stages]
        for field, values in {
            "nx": [*states, 2],
            "nu": [2] * n + [0],
            "nz": [0] * (n + 1),
            "ns": [0] * (n + 1),
        }.items():
            self._lib.ocp_nlp_dims_set_opt_vars(
                self._config, self._dims, field.encode(), self._ffi.new("int[]", values)
            )
        for k in range(n + 1):
            bounds = {
                "nbx": 2 if k else states[0],
                "nbxe": 0 if k else states[0],
                "nbu": 2 * (k < n),
            }
            for field, value in bounds.items():
                self._lib.ocp_nlp_dims_set_constraints(
                    self._config, self._dims, k, field.encode(), self._ffi.new("int *", value)
                )
            ny = stages[k].outputs.size1_out(0) + 2 if k < n else 0
            self._lib.ocp_nlp_dims_set_cost(
                self._config, self._dims, k, b"ny", self._ffi.new("int *", ny)
            )

    def _connected(self, compiled: Any) -> list[list[Any]]:
        """Give acados the functions of every stage; returns them, for their parameters."""
        connected = []
        for k, stage in enumerate(self._stages.stages):
            functions = []
            for name, field in _FIELDS.items():
                function = self._ffi.new("external_function_param_casadi *")
                for i, suffix in enumerate(_SUFFIXES):
                    function.casadi[i] = self._ffi.addressof(compiled, f"{name}_{k}{suffix}")
                self._lib.external_function_param_casadi_create(function, stage.n_parameters)
                owner = "dynamics" if name.startswith("step") else "cost"
                setter = getattr(self._lib, f"ocp_nlp_{owner}_model_set")
                setter(*self._at, self._in, k, field.encode(), function)
                functions.append(function)
            connected.append(functions)
        return connected

    def _set_constants(self) -> None:
        n = len(self._stages.stages)
        for k in range(n + 1):
            unit = self._ffi.new("double *", 1.0)
            if k < n:
                self._lib.ocp_nlp_in_set(*self._at, self._in, k, b"Ts", unit)
            self._lib.ocp_nlp_cost_model_set(*self._at, self._in, k, b"scaling", unit)
            places = (
                INPUTS if 0 < k < n else range(2) if k else range(self._stages.stages[0].n_states)
            )
            self._constrain(k, "idxbx", self._ffi.new("int[]", list(places)))
            if not k:
                self._constrain(k, "idxbxe", self._ffi.new("int[]", list(places)))
            if k < n:
                self._constrain(k, "idxbu", self._ffi.new("int[]", [0, 1]))
                self._constrain(k, "lbu", self._doubles(-np.ones(2)))
                self._constrain(k, "ubu", self._doubles(np.ones(2)))

    def _give(self, states: list[Vector], inputs: Vector, data: list[StageData]) -> None:
        """Numbers of a problem, and where the iteration starts."""
        for side in ("lbx", "ubx"):
            self._constrain(0, side, self._doubles(states[0]))
        for k, of_stage in enumerate(data):
            parameter = self._doubles(of_stage.parameter)
            for function in self._functions[k]:
                function.set_param(function, parameter)
            weight = np.diag(np.concatenate([of_stage.weight, of_stage.move_weight]))
            goal = np.concatenate([of_stage.goal, np.zeros(2)])
            for field, value in (("W", weight), ("yref", goal)):
                self._lib.ocp_nlp_cost_model_set(
                    *self._at, self._in, k, field.encode(), self._doubles(value)
                )
            self._constrain(k + 1, "lbx", self._doubles(of_stage.input_low))
            self._constrain(k + 1, "ubx", self._doubles(of_stage.input_high))
            self._lib.ocp_nlp_out_set(*self._at, self._out, k, b"u", self._doubles(inputs[k]))
        for k, state in enumerate(states):
            self._lib.ocp_nlp_out_set(*self._at, self._out, k, b"x", self._doubles(state))

    def _taken(self, stage: int) -> Vector:
        inputs = np.zeros(2)
        self._lib.ocp_nlp_out_get(*self._at, self._out, stage, b"u", self._doubles(inputs))
        return inputs

    def _constrain(self, stage: int, field: str, value: Any) -> None:
        self._lib.ocp_nlp_constraints_model_set(*self._at, self._in, stage, field.encode(), value)

    def _option(self, field: str, kind: str, value: float | bytes) -> None:
        given = self._ffi.new(kind if isinstance(value, bytes) else f"{kind} *", value)
        self._lib.ocp_nlp_solver_opts_set(self._config, self._opts, field.encode(), given)

    def _doubles(self, array: Vector) -> Any:
        """A pointer to an array, which has to stay until acados has read it."""
        return self._ffi.from_buffer(
            "double[]", np.ascontiguousarray(array), require_writable=False
        )
