"""Several processes: signals, exit codes, idle CPU, many at once, what is missing."""

from __future__ import annotations

import signal
import time
from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from std_msgs.msg import String

SPIN = """
import sys
import rclpy
from rclpy.executors import ExternalShutdownException
rclpy.init()
node = rclpy.create_node("spinner")
node.declare_parameter("gain", 1.5)
def ready():
    timer.cancel()
    print("ready", flush=True)
try:
    timer = node.create_timer(0.0, ready)
    rclpy.spin(node)
except KeyboardInterrupt:
    print("KeyboardInterrupt")
except ExternalShutdownException:
    print("ExternalShutdownException")
# A thread of its own shuts the context down.
import time
end = time.monotonic() + 120
while rclpy.ok() and time.monotonic() < end:
    time.sleep(0.001)
print(rclpy.ok())
node.destroy_node()
rclpy.try_shutdown()
"""
ECHO = """
import rclpy
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node("echo")
publisher = node.create_publisher(String, "back", 10)
node.create_subscription(String, "there", lambda message: publisher.publish(message), 10)
print("ready", flush=True)
rclpy.spin(node)
"""
THREAD = """
import threading
import rclpy
rclpy.init()
node = rclpy.create_node("threaded")
ended = threading.Event()
def ready():
    timer.cancel()
    print("ready", flush=True)
def spin():
    try:
        rclpy.spin(node)
    except Exception:
        # ExternalShutdownException; genuine rclpy may also notice the end in the middle of something.
        pass
    print("ended", flush=True)
    ended.set()
timer = node.create_timer(0.0, ready)
threading.Thread(target=spin).start()
try:
    ended.wait()
except KeyboardInterrupt:
    ended.wait()
"""
IDLE = """
import time
import rclpy
rclpy.init()
node = rclpy.create_node("idle")
executor = rclpy.get_global_executor()
executor.add_node(node)
executor.spin_once(timeout_sec=0.5)
for _ in range(20):
    start, cpu = time.monotonic(), time.process_time()
    while time.monotonic() < start + 3:
        executor.spin_once(timeout_sec=start + 3 - time.monotonic())
    share = (time.process_time() - cpu) / (time.monotonic() - start)
    if share < 0.01:
        break
print(share)
"""
ONE_OF_MANY = """
import sys
import rclpy
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node("node_" + sys.argv[1], enable_rosout=False, start_parameter_services=False)
publisher = node.create_publisher(String, "roll_call", 10)
node.create_subscription(String, "call", lambda _: publisher.publish(String(data=sys.argv[1])), 10)
print("ready", flush=True)
rclpy.spin(node)
"""


@pytest.fixture
def wait_asleep(wait_until: Any) -> Any:
    """Waits until all threads of a program wait: genuine rclpy may fail when a signal comes in between."""

    def wait(program: Any) -> None:
        tasks = Path(f"/proc/{program.process.pid}/task")
        seen: list[bool] = []

        def asleep() -> bool:
            try:
                states = {(task / "stat").read_text().rpartition(")")[2].split()[0] for task in tasks.iterdir()}
            except OSError:  # a thread has just ended
                states = set()
            seen.append(states == {"S"})
            return len(seen) >= 20 and all(seen[-20:])

        assert wait_until(asleep)

    return wait


@pytest.mark.parametrize(
    ("number", "outcome"),
    [(signal.SIGINT, "KeyboardInterrupt"), (signal.SIGTERM, "ExternalShutdownException")],
)
def test_signals_end_spin(
    run_program: Any, wait_asleep: Any, genuine: bool, number: signal.Signals, outcome: str
) -> None:
    program = run_program(SPIN)
    assert program.line() == "ready"
    wait_asleep(program)
    program.process.send_signal(number)
    code, out, err = program.finish()
    allowed = [[outcome, "False"]]
    if number == signal.SIGTERM:
        # As with genuine rclpy, a spin that was not waiting just then ends without an exception.
        allowed.append(["False"])
    elif genuine:
        # Where the machine is busy, it sees its context shut down before Python handles the signal.
        allowed.append(["ExternalShutdownException", "False"])
    assert out.split() in allowed
    assert code == 0 and err == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_a_spin_in_a_thread(
    run_program: Any, wait_asleep: Any, number: signal.Signals, genuine: bool
) -> None:
    if genuine:
        pytest.skip("rclpy 7.1 may wake such a spin before the context is shut down, and it then waits for ever")
    program = run_program(THREAD)
    assert program.line() == "ready"
    wait_asleep(program)
    program.process.send_signal(number)
    assert program.line() == "ended"
    assert program.finish()[0] == 0


def test_talk_to_another_process(node: Any, spinner: Any, run_program: Any) -> None:
    got: list[str] = []
    node.create_subscription(String, "back", lambda message: got.append(message.data), 10)
    publisher = node.create_publisher(String, "there", 10)
    program = run_program(ECHO)
    assert program.line() == "ready"
    assert spinner.until(lambda: publisher.get_subscription_count() == 1 and node.count_publishers("back") == 1)

    def answered() -> bool:
        """What comes back before the other one knows of our subscription is lost."""
        publisher.publish(String(data="0"))
        return bool(got)

    assert spinner.until(answered)
    for count in range(1, 6):
        publisher.publish(String(data=str(count)))
        assert spinner.until(lambda count=count: str(count) in got)
    assert [text for text in got if text != "0"] == ["1", "2", "3", "4", "5"]


def test_parameters_of_another_process(node: Any, spinner: Any, run_program: Any) -> None:
    program = run_program(SPIN)
    assert program.line() == "ready"
    client = AsyncParameterClient(node, "/spinner")
    assert client.wait_for_services(120)
    future = client.set_parameters([Parameter("gain", value=2.5)])
    assert spinner.until(future.done)
    assert future.result().results[0].successful
    future = client.get_parameters(["gain", "use_sim_time"])
    assert spinner.until(future.done)
    assert [value.double_value for value in future.result().values] == [2.5, 0.0]


def test_rosout_of_another_process(node: Any, spinner: Any, run_program: Any) -> None:
    from rcl_interfaces.msg import Log
    from rclpy.qos import QoSDurabilityPolicy, QoSProfile

    got: list[Any] = []
    profile = QoSProfile(depth=100, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(Log, "/rosout", got.append, profile)
    source = SPIN.replace("timer.cancel()", 'timer.cancel(); node.get_logger().warning("low oil")')
    program = run_program(source)
    assert program.line() == "ready"
    assert spinner.until(lambda: any(log.name == "spinner" and log.msg == "low oil" for log in got))
    assert next(log for log in got if log.msg == "low oil").level == 30


def test_idle_node_uses_little_cpu(run_program: Any) -> None:
    program = run_program(IDLE)
    _, out, err = program.finish()
    # Of several windows: others on the machine make work more expensive.
    assert float(out) < 0.01, err


@pytest.mark.full
def test_40_processes(
    domain_id: int, run_program: Any, wait_until: Any, monkeypatch: pytest.MonkeyPatch, genuine: bool
) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    if genuine:
        # Known difference: in this range rmw_cyclonedds_cpp stops at 33 processes unless told otherwise.
        discovery = "<Discovery><MaxAutoParticipantIndex>50</MaxAutoParticipantIndex></Discovery>"
        monkeypatch.setenv("CYCLONEDDS_URI", f"<CycloneDDS><Domain>{discovery}</Domain></CycloneDDS>")
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor

    programs = [run_program(ONE_OF_MANY, str(number)) for number in range(40)]
    assert all(program.line() == "ready" for program in programs)
    context = Context()
    context.init(args=[], domain_id=domain_id)
    try:
        node = rclpy.create_node("caller", context=context)
        present: set[str] = set()
        node.create_subscription(String, "roll_call", lambda message: present.add(message.data), 100)
        publisher = node.create_publisher(String, "call", 10)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        end = time.monotonic() + 240
        while len(present) < 40 and time.monotonic() < end:
            publisher.publish(String())
            next_call = time.monotonic() + 0.5
            while time.monotonic() < next_call and len(present) < 40:
                executor.spin_once(timeout_sec=0.05)
        assert present == {str(number) for number in range(40)}
        assert wait_until(lambda: len(node.get_node_names()) == 41)
        executor.shutdown()
    finally:
        context.destroy()
