"""fsw.py lifecycle against a managed node that is spun in a thread."""

import os
import signal
import sys
import threading

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from fsw.main import main
from fsw_control.managed_node_ros import ManagedNode
from fsw_control.node_main_ros import run as run_node

pytestmark = pytest.mark.slow


class Welder(ManagedNode):
    def activate(self):
        raise ValueError("no tool")


@pytest.fixture
def welder(domain_id):
    context = Context()
    rclpy.init(args=[], context=context, domain_id=domain_id)
    node, executor = (
        Welder("welder", namespace="cell", context=context),
        SingleThreadedExecutor(context=context),
    )
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    yield node
    executor.shutdown()
    thread.join()
    node.destroy_node()
    context.try_shutdown()


def test_states_are_listed_and_changed_or_refused_with_a_reason(welder, capsys):
    def fsw(*words):
        code = main(["lifecycle", *words, "--namespace", "cell", "--timeout", "60"])
        printed, error = capsys.readouterr()
        return (
            code,
            printed,
            "".join(error.splitlines(keepends=True)[-1:]),
        )  # without the node's log

    assert fsw("list")[1].split() == ["node", "state", "welder", "unconfigured"]
    assert fsw("get", "welder") == (0, "welder: unconfigured\n", "")
    assert fsw("set", "welder", "configure") == (0, "welder: inactive\n", "")
    code, printed, error = fsw("set", "welder", "activate")
    assert (code, printed) == (1, "") and "cannot activate" in error and "no tool" in error
    code, _, error = fsw("set", "welder", "configure")
    assert code == 1 and "welder is inactive" in error and "transition configure" in error
    assert error.endswith("cleanup, activate, shutdown\n")
    assert [line.split()[0] for line in fsw("list", "welder")[1].splitlines()] == [
        "cleanup",
        "activate",
        "shutdown",
    ]
    assert fsw("set", "welder", "shutdown") == (0, "welder: finalized\n", "")
    code, printed, error = fsw("set", "welder", "configure")
    assert (code, printed) == (1, "")
    assert "welder is finalized" in error and error.endswith(" none\n")


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_shutdown_of_a_node_is_a_success(monkeypatch, domain_id, sent):
    """Neither for a command, which takes both for an interruption."""
    monkeypatch.setattr(
        "fsw_plant.plant_node.main",
        lambda: run_node(lambda: os.kill(os.getpid(), sent), ["plant"]),
    )
    monkeypatch.setattr(sys, "argv", ["fsw.py"])
    defaults = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    before = {sign: signal.signal(sign, default) for sign, default in defaults.items()}
    try:
        assert main(["node", "plant"]) == 0
    finally:
        for sign, handler in before.items():
            signal.signal(sign, handler)
