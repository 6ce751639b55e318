"""Nodes as processes: how they end, and how they refuse to start."""

import contextlib
import runpy
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import rclpy
from sensor_msgs.msg import Temperature
from std_msgs.msg import String

from fsw_control import Reference, run_controller
from fsw_control import messages_ros as convert
from fsw_control.topics_ros import LATCHED, SENT, STREAM
from fsw_msgs.msg import ShoulderDepth, SpindleTorque, WeldCommand, WeldReference
from fsw_test_support.waiting import PATIENCE_S, wait_until

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("domain_id")]
EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "my_controller.py"


def launch(*arguments):
    return subprocess.Popen(
        [sys.executable, str(EXAMPLE), *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process, seconds=PATIENCE_S):
    try:
        out, err = process.communicate(timeout=seconds)
    finally:
        process.kill()
    return process.returncode, out + err


@pytest.fixture
def peer(domain_id):
    rclpy.init(domain_id=domain_id)
    node = rclpy.create_node("peer")
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def wait(node, condition, seconds=PATIENCE_S):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "condition not reached"
        rclpy.spin_once(node, timeout_sec=0.05)


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_the_example_answers_and_ends_cleanly(peer, sent):
    proposals = []
    peer.create_subscription(WeldCommand, "/fsw/depth_only/proposal", proposals.append, STREAM)
    publishers = [
        (
            peer.create_publisher(ShoulderDepth, "/fsw/depth", STREAM),
            convert.sensor_message("depth", 2.65, 0),
        ),
        (
            peer.create_publisher(SpindleTorque, "/fsw/spindle_torque", STREAM),
            convert.sensor_message("torque", 1052.0, 0),
        ),
        (
            peer.create_publisher(Temperature, "/fsw/thermocouple", STREAM),
            convert.sensor_message("thermocouple", 850.0, 0),
        ),
    ]
    references = peer.create_publisher(WeldReference, "/fsw/reference", LATCHED)
    references.publish(convert.reference_message(Reference(2.66, 850.0), 0))
    process = launch()
    try:
        wait(peer, lambda: peer.count_publishers("/fsw/depth_only/proposal") == 1)
        wait(
            peer,
            lambda: all(publisher.get_subscription_count() == 1 for publisher, _ in publishers),
        )
        stamp = 0

        def answered():
            # The latched reference may come after the first ticks.
            nonlocal stamp
            stamp += 100_000_000
            for publisher, message in publishers:
                message.header.stamp = convert.stamp_from_ns(stamp)
                publisher.publish(message)
            return proposals and proposals[-1].healthy

        wait(peer, answered)
        assert proposals[-1].source == "depth_only"
        assert proposals[-1].axial_force == pytest.approx(78_400.0 + 500.0)
        process.send_signal(sent)
        code, text = finish(process)
    finally:
        process.kill()
    assert code == 0
    assert "Traceback" not in text


def lines(text):
    """Without what rcl may have logged of arguments that it cannot parse."""
    return [line for line in text.strip().splitlines() if "[rcl]" not in line]


def test_a_parameter_out_of_range_ends_the_start_with_one_line():
    code, text = finish(launch("--ros-args", "-p", "deadline:=5.0"))
    assert code == 2
    assert "deadline" in text and len(lines(text)) == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--ros-args", "-p", "deadline:=soon"), "deadline"),
        (("--ros-args", "-p", "validity.depth.minimum:=9.0"), "minimum"),
        (("--wrong",), "unknown arguments --wrong"),
        (("--ros-args", "--params-file", "/nonexistent.yaml"), "/nonexistent.yaml"),
    ],
)
def test_bad_arguments_are_reported_in_one_line(arguments, said, monkeypatch, capfd):
    monkeypatch.setattr(sys, "argv", ["my_controller", *arguments])
    assert run_controller(runpy.run_path(str(EXAMPLE))["DepthOnly"]) == 2
    text = "".join(capfd.readouterr())
    assert said in text and len(lines(text)) == 1


NODE = """
import sys
from rclpy.node import Node
from fsw_control.light_node_ros import LightNode
from fsw_control.node_main_ros import run

class Busy(LightNode, Node):
    def __init__(self):
        super().__init__("busy")
        self.timer = self.create_timer(0.001, self.tick)
        self.ticked = False

    def tick(self):
        if not self.ticked:
            print("spinning", flush=True)
        self.ticked = True
        %s

    def destroy_node(self):
        print("closing", flush=True)
        sys.stdin.readline()
        print("closed", flush=True)
        super().destroy_node()

sys.exit(run(Busy))
"""


@contextlib.contextmanager
def spinning(tick="pass"):
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen([sys.executable, "-c", NODE % tick], text=True, **pipes) as process:
        try:
            assert process.stdout.readline() == "spinning\n"
            yield process
        finally:
            process.kill()


def last_words(process):
    """Let the node close; what it still prints."""
    process.stdin.write("\n")
    process.stdin.close()
    text = process.stdout.read()  # not communicate(), which forgets what readline() has read ahead
    process.wait()
    return text


@pytest.mark.parametrize("first", [signal.SIGINT, signal.SIGTERM])
def test_more_interrupts_do_not_cut_off_the_end(domain_id, first):
    with spinning() as process:
        process.send_signal(first)
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "closing\n"
        for _ in range(2):
            process.send_signal(signal.SIGINT)
        text = last_words(process)
    assert text == "closed\n"
    assert process.returncode == 0


SPEAKER = """
import sys
from std_msgs.msg import String
from rclpy.node import Node
from fsw_control.light_node_ros import LightNode
from fsw_control.node_main_ros import run
from fsw_control.topics_ros import SENT

class Speaker(LightNode, Node):
    def __init__(self):
        super().__init__("speaker")
        self.publisher = self.create_publisher(String, "/spoken", SENT)
        self.create_timer(0.001, self.speak)

    def speak(self):
        if self.publisher.get_subscription_count() and sys.stdin.readline():
            print("speaking", flush=True)
            sys.stdin.readline()
            for number in range(200):
                self.publisher.publish(String(data=str(number)))

sys.exit(run(Speaker))
"""


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_messages_published_after_a_signal_arrive(peer, sent):
    heard = []
    peer.create_subscription(
        String, "/spoken", lambda message: heard.append(int(message.data)), SENT
    )
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", SPEAKER], text=True, **pipes) as process:
        try:
            process.stdin.write("begin\n")
            process.stdin.flush()
            assert process.stdout.readline() == "speaking\n"
            process.send_signal(sent)
            last_words(process)
        finally:
            process.kill()
    assert process.returncode == 0
    wait(peer, lambda: len(heard) == 200)
    assert heard == list(range(200))


def test_a_signal_ends_a_node_that_only_waits(domain_id):
    with spinning("self.timer.cancel()") as process:
        state = Path(f"/proc/{process.pid}/stat")
        wait_until(
            lambda: state.read_text().rpartition(")")[2].split()[0] == "S",
            "it waits in the middleware",
        )
        process.send_signal(signal.SIGTERM)
        text = last_words(process)
    assert text == "closing\nclosed\n"
    assert process.returncode == 0


def test_shutdown_within_a_callback_ends_cleanly(domain_id):
    with spinning("import rclpy; rclpy.shutdown(); self.create_publisher(str, 'x', 1)") as process:
        text = last_words(process)
    assert text == "closing\nclosed\n"
    assert process.returncode == 0


def test_error_in_a_callback_ends_with_its_traceback(domain_id):
    with spinning("1 / 0") as process:
        text = last_words(process)
    assert "ZeroDivisionError" in text
    assert "closed\n" in text
    assert process.returncode == 1


def test_second_interrupt_breaks_a_callback_that_does_not_return(domain_id):
    with spinning("while True: pass") as process:
        process.send_signal(signal.SIGINT)
        ended = threading.Event()

        def insist():
            """A second after the first one, as the node has seen it.

            On a busy machine it sees that late.
            """
            while not ended.wait(1.2):
                process.send_signal(signal.SIGINT)

        again = threading.Thread(target=insist)
        again.start()
        text = last_words(process)
        ended.set()
        again.join()
    assert text == "closing\nclosed\n"
    assert process.returncode == 0


LATE = """
import os
from rclpy.node import Node
from fsw_control.node_main_ros import run

class Late:
    def __del__(self):  # while the interpreter ends: Python has put the signals' default actions back
        os.write(1, b"ending\\n")
        os.read(0, 1)

def node():
    raise ValueError("refused")

late = Late()
run(node)
"""


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_the_interpreter_ends_leaves_the_exit_code(domain_id, sent):
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", LATE], text=True, **pipes) as process:
        try:
            assert process.stdout.readline() == "ending\n"
            process.send_signal(sent)
            last_words(process)
        finally:
            process.kill()
    assert process.returncode == 0


@pytest.mark.parametrize("discovery", ["LOCALHOST", "SUBNET"])
def test_a_node_uses_no_shared_memory(domain_id, monkeypatch, discovery):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", discovery)
    monkeypatch.delenv("FASTRTPS_DEFAULT_PROFILES_FILE")
    code = """
from pathlib import Path
from rclpy.node import Node
from fsw_control.node_main_ros import run

def factory():
    node = Node("mapped")
    print("fastrtps_port" in Path("/proc/self/maps").read_text())
    raise SystemExit

run(factory, ["mapped"])
"""
    assert (
        subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True).stdout
        == "False\n"
    )
