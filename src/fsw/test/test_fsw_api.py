"""``import fsw``: what its docstrings show, and that it tells what the command line and the model tell."""

import copy
import csv
import json
import pickle
import subprocess
import sys
from pathlib import Path
from runpy import run_path

import casadi as ca
import numpy as np
import pytest

import fsw
from fsw.main import main
from fsw.simulation import overrides_of
from fsw_control.schema.models import InputError
from fsw_test_support.doc_examples import check, examples

EXAMPLES = examples(set(fsw.MODULE_OF.values()) - {"fsw_control.contract"})
#: modules that some examples need, which are extras
NEEDED = {
    "to_pandas": "pandas",
    "to_xarray": "xarray",
    "linearise": "control",
    "to_do_mpc": "do_mpc",
}


def missing(facts, raised):
    """The facts that the text of an error lacks."""
    return [fact for fact in facts if fact not in str(raised.value)]


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_the_examples_in_the_docstrings(example):
    pytest.importorskip(NEEDED.get(example.name.rpartition(".")[2], "fsw"))
    check(example)


def test_every_public_name_has_an_example():
    shown = {example.name for example in EXAMPLES}
    for name, place in fsw.MODULE_OF.items():
        if place != "fsw_control.contract":
            assert f"{place}.{name}" in shown


def test_import_loads_no_heavy_module():
    code = (
        "import sys, fsw; print(sorted({'numpy', 'casadi', 'matplotlib', "
        "'rclpy'} & set(sys.modules)))"
    )
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout
        == "[]\n"
    )


@pytest.mark.slow
def test_a_weld_and_its_figure_need_no_extra(tmp_path):
    code = """if True:
        import sys
        sys.modules |= dict.fromkeys(["casadi", "scipy", "rclpy"])  # an import of them fails
        import fsw
        fsw.compare("quick", ["nmpc", "decentral"]).plot().savefig("figure.png")
        print(round(fsw.model().process.equilibrium().speed_rpm, 3))
        try:
            fsw.model().equation(19)
        except ImportError as error:
            print("fsw-control[science]" in str(error))
    """
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert (done.stdout, done.returncode) == ("407.576\nTrue\n", 0), done.stderr
    assert (tmp_path / "figure.png").is_file()


def test_a_simulation_is_that_of_the_command_line(tmp_path):
    out = tmp_path / "out"
    assert (
        main(
            [
                "simulate",
                "quick",
                "--controller",
                "decentral:tight",
                "--out",
                str(out),
                "--no-figures",
            ]
        )
        == 0
    )
    with (out / "signals_decentral_tight.csv").open() as file:
        rows = list(csv.DictReader(file))
    weld = fsw.simulate("quick", "decentral:tight")
    assert [float(row["truth_depth_mm"]) for row in rows] == weld["truth_depth_mm"].tolist()


def test_plant_parameters_and_changes_arrive():
    weld = fsw.simulate(
        "quick", plant={"start.depth_mm": 2.7}, changes={"events[0].at_s": 1.0}, noise=False
    )
    assert weld["depth_mm"][0] == pytest.approx(2.7)
    assert weld["reference_depth_mm"][10] == 2.76
    tight = fsw.simulate("quick", "decentral", parameters={"tuning": "tight"})
    assert tight.kpi["iae_depth_mm_s"] < fsw.simulate("quick").kpi["iae_depth_mm_s"]


@pytest.mark.parametrize(
    ("scenario", "options", "facts"),
    [
        ("nowhere", {}, ["nowhere"]),
        ("quick", {"controller": "nobody"}, ["nobody"]),
        ("quick", {"plant": {"no_such": 1.0}}, ["no_such"]),
        ("quick", {"parameters": {"tuning": "tight"}}, ["parameters", "its name"]),
        ("open_loop_force_steps", {"controller": "nmpc"}, ["open-loop"]),
        ("quick", {"controller": fsw.Controller}, ["controller", "an object"]),
        ("quick", {"changes": {"events": {(1, 2): 3}}}, ["events is", "number", "list"]),
        ("quick", {"plant": {"seed": b"3"}}, ["plant.seed is", "number", "mapping", "b'3'"]),
    ],
)
def test_wrong_arguments_are_refused_by_name(scenario, options, facts):
    with pytest.raises(InputError) as raised:
        fsw.simulate(scenario, **options)
    assert missing(facts, raised) == []


TEXT, PATH = "string_type", "is_instance_of"


@pytest.mark.parametrize("controllers", ["decentral", [], 3, ["decentral", 3]])
def test_a_comparison_takes_a_list(controllers):
    with pytest.raises(InputError, match="compare: controllers"):
        fsw.compare("quick", controllers)


@pytest.mark.parametrize(
    ("call", "function", "argument", "kinds"),
    [
        (lambda: fsw.simulate("quick", 3), "simulate", "controller", {TEXT, PATH}),
        (lambda: fsw.simulate("quick", plant=3), "simulate", "plant", {"dict_type", PATH}),
        (lambda: fsw.simulate("quick", changes="a=3"), "simulate", "changes", {"dict_type"}),
        (lambda: fsw.simulate(None), "simulate", "scenario", {TEXT, PATH, "dict_type"}),
        (lambda: fsw.simulate("quick", noise="no"), "simulate", "noise", {"bool_type"}),
        (lambda: fsw.simulate("quick", progress=3), "simulate", "progress", {"callable_type"}),
        (lambda: fsw.read_bag(None), "read_bag", "bag", {TEXT, PATH}),
        (lambda: fsw.model([]), "model", "source", {TEXT, PATH}),
        (lambda: fsw.model({"dead_time_s": 2.0}), "model", "source", {TEXT, PATH}),
        (lambda: fsw.model(np.eye(2)), "model", "source", {TEXT, PATH}),
        (lambda: fsw.model(dead_time_s="x"), "model", "values.dead_time_s", {"float_type"}),
        (lambda: fsw.Model(3), "Model", "parameters", {PATH}),
        (lambda: fsw.model().equation([]), "equation", "number", {"int_type"}),
        (lambda: fsw.model().equation(True), "equation", "number", {"int_type"}),
        (lambda: fsw.model().linearise("a"), "linearise", "depth_mm", {"float_type"}),
        (lambda: fsw.model().linearise(True), "linearise", "depth_mm", {"float_type"}),
        (lambda: fsw.model().linearise(delay="a"), "linearise", "delay", {"literal_error"}),
    ],
)
def test_an_argument_of_a_wrong_type_is_a_problem_in_one_line(call, function, argument, kinds):
    with pytest.raises(InputError) as raised:
        call()
    problems = raised.value.problems
    assert {problem.path for problem in problems} == {argument}
    assert {problem.kind for problem in problems} == kinds
    assert str(raised.value).startswith(f"{function}: {argument} is ")
    assert "\n" not in str(raised.value)


def test_all_wrong_arguments_are_problems_at_once():
    with pytest.raises(InputError) as raised:
        fsw.simulate("quick", noise=1, progress="often")
    assert {problem.path for problem in raised.value.problems} == {"noise", "progress"}


def test_numpy_numbers_are_accepted():
    assert overrides_of({"seed": np.int64(3)}, None, None) == overrides_of({"seed": 3}, None, None)
    assert (
        fsw.model(dead_time_s=np.float32(1.5)).parameters == fsw.model(dead_time_s=1.5).parameters
    )
    assert fsw.model().equation(np.int64(19))(78.4, 2.66) == fsw.model().equation(19)(78.4, 2.66)


def test_python_type_errors_name_the_function():
    with pytest.raises(TypeError, match="read_bag"):
        fsw.read_bag()


def test_a_figure_that_is_not_there_is_named():
    with pytest.raises(InputError, match=r"figure 99;.* 4, 5, 6, 7, 8, 9"):
        fsw.simulate("quick").plot(99)


def test_a_signal_that_is_not_there_and_an_extra_that_is_missing_are_named(monkeypatch):
    weld = fsw.simulate("quick")
    with pytest.raises(KeyError, match=r"signal dept_mm; .* depth_mm"):
        weld["dept_mm"]
    with pytest.raises(KeyError, match=r"signal x; .*list\(weld.table\)"):
        weld["x"]
    with pytest.raises(KeyError, match="signal 3"):
        weld[3]
    for module in ("pandas", "xarray", "control", "do_mpc.model"):
        monkeypatch.setitem(sys.modules, module, None)
    for convert in (weld.to_pandas, weld.to_xarray, fsw.model().linearise, fsw.model().to_do_mpc):
        with pytest.raises(ImportError, match=r"'fsw-control\[science\]'"):
            convert()


class Nothing(fsw.Controller):
    name = "nothing"


class Silent(Nothing):
    def command(self, *_):
        return None


class Blank(Nothing):
    def command(self, *_):
        return fsw.Command(float("nan"), 400.0)


class Late(Nothing):
    def command(self, measurement, reference, applied):
        if measurement.time_s < 10.0:
            raise ValueError("not yet")
        return applied


@pytest.mark.parametrize(
    ("controller", "why"),
    [(Nothing, "method 'command'"), (Silent, "NoneType"), (Blank, "not finite")],
)
def test_a_controller_that_never_proposes_a_command_has_no_figures(controller, why):
    with pytest.raises(InputError, match=f"^quick: nothing .* 600 ticks: .*{why}"):
        fsw.simulate("quick", controller())


def test_the_last_command_is_held_while_a_controller_proposes_none():
    weld = fsw.simulate("quick", Late())
    assert set(weld["command_source"][:90]) == {"hold"} and set(weld["command_source"][110:]) == {
        "nothing"
    }
    [remark] = weld.signals.problems
    held = weld["command_source"] == "hold"
    assert f"{held.sum()} of 600 ticks" in remark and f"{1.0 - held.mean():.1%}" in remark
    assert "tick 1 (0.1 s)" in remark and "not yet" in remark
    assert fsw.simulate("quick").signals.problems == []


def test_welds_of_equal_labels_are_kept_apart():
    both = fsw.compare("quick", [Late(), Late(), "decentral"])
    assert list(both) == ["nothing", "nothing (2)", "decentral"]
    assert {label: weld.label for label, weld in both.kpi.items()} == {
        label: label for label in both
    }
    with pytest.raises(KeyError, match="mean decentral"):
        both["decentrl"]
    table = str(both)
    for label in list(both)[:2]:  # figures of a held command have a remark
        assert f"- {label}: {both[label].signals.problems[0]}" in table
    assert "- decentral:" not in table
    assert fsw.simulate("quick", label="mine").label == "mine"


class Integrating(fsw.Controller):
    name = "integrating"

    def __init__(self):
        self.errors_mm = []

    def command(self, measurement, reference, applied):
        self.errors_mm.append(reference.depth_mm - measurement.depth_mm)
        return fsw.Command(78.4 + 0.05 * sum(self.errors_mm), applied.speed_rpm)


def test_controllers_of_different_welds_share_no_state():
    controller = Integrating()
    both = fsw.compare("quick", {"first": controller, "second": controller})
    assert np.array_equal(both["first"]["depth_mm"], both["second"]["depth_mm"])
    assert controller.errors_mm == []
    assert [len(weld.controller.errors_mm) for weld in both.values()] == [600, 600]


@pytest.mark.parametrize("controller", ["decentral", "nmpc", Integrating()])
def test_a_weld_can_be_copied_and_comes_from_another_process(controller):
    weld = fsw.simulate(STEP, controller)
    assert (weld.controller is None) == isinstance(controller, str)
    for same in (copy.deepcopy(weld), pickle.loads(pickle.dumps(weld))):
        assert same.controller is None and same.kpi == weld.kpi
        assert same["depth_mm"].tobytes() == weld["depth_mm"].tobytes()


def test_what_cannot_be_copied_welds_only_with_a_copy_of_its_own_making():
    controller = Integrating()
    controller.solver = (step for step in range(3))
    plant = Lag()
    plant.solver = controller.solver
    for options in ({"controller": controller}, {"plant": plant}):
        with pytest.raises(InputError, match=r"cannot be copied: .*generator.*__deepcopy__"):
            fsw.simulate("quick", **options)
    assert controller.errors_mm == []


def test_parameters_in_a_comparison_are_by_label():
    both = fsw.compare(
        "quick",
        {"slow": "decentral", "fast": "decentral"},
        parameters={"fast": {"tuning": "tight"}},
    )
    assert both["fast"].kpi.iae_depth_mm_s < both["slow"].kpi.iae_depth_mm_s
    for wrong, fact in (({"tuning": "tight"}, "tuning"), ({"nmpc": {}}, "nmpc")):
        with pytest.raises(InputError, match=rf"^compare: parameters.*{fact}"):
            fsw.compare("quick", ["decentral"], parameters=wrong)


def test_figures_of_merit_are_typed():
    kpi = fsw.simulate("quick").kpi
    assert set(fsw.Kpi.__annotations__) == set(kpi)
    assert kpi.iae_depth_mm_s == kpi["iae_depth_mm_s"] and "iae_depth_mm_s" in dir(kpi)
    assert json.loads(json.dumps(kpi)) == kpi
    with pytest.raises(AttributeError, match="iae_depth_mm_s"):
        kpi.iae_depth  # noqa: B018
    with pytest.raises(KeyError, match="iae_depth_mm_s"):
        kpi["iae_depth"]
    with pytest.raises(AttributeError, match="ticks"):
        kpi.ticks = 5


class Lag:
    """A process whose depth follows the force."""

    def __init__(self, last=(2.7, 816.4, 1000.0), force_kn=78.4):
        self.last, self.force_kn = last, force_kn

    def start(self):
        self.depth_mm = 2.66
        return fsw.Command(self.force_kn, 407.6), fsw.Outputs(2.66, 816.4, 1000.0)

    def step(self, command):
        if self.last != (2.7, 816.4, 1000.0):
            return self.last
        self.depth_mm += 0.02 * (2.66 + 0.02 * (command.force_kn - 78.4) - self.depth_mm)
        return fsw.Outputs(self.depth_mm, 816.4, 1000.0)


STEP = {
    "name": "step",
    "duration_s": 30.0,
    "events": [{"at_s": 5.0, "reference": {"depth_mm": 2.76}}],
}


def test_a_process_of_ones_own_is_controlled():
    plant = Lag()
    weld = fsw.simulate(STEP, "decentral", plant=plant)
    assert weld["depth_mm"][0] == 2.66 and weld["depth_mm"][-1] == pytest.approx(2.76, abs=0.02)
    assert weld.kpi.outputs == "measured" and not hasattr(plant, "depth_mm")
    assert np.array_equal(weld["drives_force_kn"][1:], weld["force_kn"][:-1])


def test_controllers_are_switched_on_a_process_of_ones_own():
    switched = STEP | {"events": [{"at_s": 5.0, "switch": "nmpc"}]}
    assert set(fsw.simulate(switched, "decentral", plant=Lag())["actual_controller"]) == {
        "decentral",
        "nmpc",
    }


@pytest.mark.parametrize(
    ("scenario", "options", "fact"),
    [
        (STEP, {"plant": Lag(), "noise": False}, "noise"),
        (STEP, {"plant": Lag(last=(2.7, 816.4))}, r"step\(\)"),
        (STEP, {"plant": Lag(last=(2.7, float("nan"), 1.0))}, "not finite"),
        (STEP, {"plant": Lag(force_kn=float("nan"))}, r"start\(\).*not finite"),
        (STEP, {"plant": Lag}, "class"),
        (STEP | {"plant": {"factors": {"copper_lag_s": 1.1}}}, {"plant": Lag()}, "copper_lag_s"),
        ("output_disturbances", {"plant": Lag()}, "disturbances"),
    ],
)
def test_what_a_process_of_ones_own_cannot_do_is_refused(scenario, options, fact):
    with pytest.raises(InputError, match=fact):
        fsw.simulate(scenario, "decentral", **options)


def test_an_error_in_a_process_of_ones_own_is_its_own():
    class Broken(Lag):
        def start(self):
            return float("x")

    with pytest.raises(ValueError, match="'x'") as raised:
        fsw.simulate(STEP, "decentral", plant=Broken())
    assert raised.traceback[-1].name == "start"


def test_discrete_form_follows_the_process():
    model = fsw.model(factors={"thermal_gain_c_per_kw": 1.1, "dead_time_s": 0.3})
    force, speed = (
        78.4 + np.r_[np.ones(20), np.zeros(40)],
        407.0 + np.r_[np.zeros(30), 5.0 * np.ones(30)],
    )
    course, x = model.process.simulate(force, speed), model.state()
    for i in range(60):
        x, y = model.discrete(x, [force[i], speed[i]])
        shown = [course[name][i] for name in ("depth_mm", "temperature_c", "motor_torque_nm")]
        assert y.full().ravel() == pytest.approx(shown, rel=1e-12)


def test_linearisations_have_the_frequency_response_of_the_process():
    control = pytest.importorskip("control")
    model = fsw.model()
    omega = np.array([0.003, 0.03, 0.3])
    exact = model.process.linearise().frequency_response(omega)
    pade = model.linearise(order=6)
    assert np.moveaxis(control.frequency_response(pade, omega).frdata, 2, 0) == pytest.approx(
        exact, rel=1e-4
    )
    tick = model.linearise(delay="exact")
    held = np.sinc(omega * 0.05 / np.pi) * np.exp(
        -0.05j * omega
    )  # an input that is held for a tick
    sampled = np.moveaxis(control.frequency_response(tick, omega).frdata, 2, 0)
    assert sampled == pytest.approx(exact * held[:, None, None], rel=2e-3)


def test_do_mpc_steps_the_same_process():
    do_mpc = pytest.importorskip("do_mpc")
    model = fsw.model()
    simulator = do_mpc.simulator.Simulator(model.to_do_mpc())
    simulator.set_param(t_step=0.1)
    simulator.setup()
    simulator.x0 = x = model.state()
    for _ in range(3):
        simulator.make_step(np.array([[79.4], [410.0]]))
        x, _ = model.discrete(x, [79.4, 410.0])
    assert np.array(simulator.x0.cat).ravel() == pytest.approx(x.full().ravel())


@pytest.mark.slow
@pytest.mark.full
def test_the_example_with_do_mpc_moves_to_the_set_point():
    pytest.importorskip("do_mpc")
    example = run_path(str(Path(__file__).resolve().parents[3] / "examples" / "do_mpc_loop.py"))
    assert 2.7 < example["main"](12) < 2.77
    made, start = example["acados_model"](), fsw.model().state()
    step = ca.Function("step", [made["x"], made["u"]], [made["disc_dyn_expr"]])
    assert step(start, [78.4, 407.576]).full().ravel() == pytest.approx(start, abs=1e-4)


def test_an_equation_that_is_not_there_is_named():
    with pytest.raises(InputError, match=r"equation 3: .* 8, 16"):
        fsw.model().equation(3)
    assert float(fsw.model().equation(27)([0, 0, 0], [0, 0])) == pytest.approx(2.66)


def test_a_keyword_of_the_model_has_the_unit_of_its_name():
    assert fsw.model(dead_time_s=3.4).parameters.dead_time_s == 3.4
    twice = fsw.model(fsw.model(dead_time_s=1.7).parameters, factors={"dead_time_s": 2.0})
    assert repr(twice) == "<Model dead_time_s=3.4>"
    assert repr(fsw.model()) == "<Model of the paper>"


def test_a_scenario_may_be_a_mapping():
    content = {"name": "mine", "controller": "decentral", "duration_s": 3.0, "plant": {"seed": 4}}
    weld = fsw.simulate(content, plant={"noise": False})
    assert weld.signals.n_ticks == 30
    with pytest.raises(fsw.InputError) as raised:
        fsw.simulate({"a": 1})
    assert "a" in {problem.path for problem in raised.value.problems}


def test_pyplot_knows_a_figure_that_is_drawn_after_its_import():
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("Agg")
    pyplot.close("all")
    drawn = fsw.simulate("quick").plot()
    known = [pyplot.figure(number) for number in pyplot.get_fignums()]
    pyplot.close("all")
    try:
        pyplot.figure(type(drawn)())
    except ValueError:
        pytest.skip("this matplotlib takes no figure made without it")
    assert known == [drawn]


def test_states_of_the_linearisations_have_names():
    pytest.importorskip("control")
    model = fsw.model()
    exact, pade = model.linearise(delay="exact"), model.linearise(order=2)
    assert exact.state_labels[:6] == pade.state_labels[:6] == model.state_names[:6]
    assert pade.state_labels[6:] == ["pade_0", "pade_1"]
    assert len(exact.state_labels) == exact.nstates == model.state().size


class Half:
    """A controller without ``tolerated_sensors`` and ``reset``."""

    name = "half"

    def step(self, measurement, reference, applied, dt_s):
        raise AssertionError


@pytest.mark.parametrize(
    "weld",
    [
        lambda: fsw.simulate("quick", controller=Half()),
        lambda: fsw.simulate("quick", controller=Half),
        lambda: fsw.compare("quick", [Half()]),
        lambda: fsw.compare("quick", {"mine": Half()}),
    ],
)
def test_an_incomplete_controller_reads_what_it_lacks(weld):
    with pytest.raises(InputError) as raised:
        weld()
    assert not missing(("reset", "tolerated_sensors"), raised)


def test_a_class_instead_of_a_controller_is_refused():
    class Whole(fsw.Controller):
        name = "whole"

    with pytest.raises(InputError) as raised:
        fsw.simulate("quick", controller=Whole)
    assert not missing(("an object", "class"), raised)
