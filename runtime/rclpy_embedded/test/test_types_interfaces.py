"""Definitions on disk: finding, parsing, importing; definition texts and stubs."""

from __future__ import annotations

import ast
import importlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import rosidl_embedded
from rosidl_embedded import catalogue, search, stubs
from rosidl_embedded.definition import InvalidInterfaceError, UnknownInterfaceError
from rosidl_embedded.description import type_sources
from rosidl_embedded.parser import PARTS, parse_structure, split_parts
from rosidl_embedded.typesupport import (
    get_interface,
    get_message,
    interface_definition,
    type_hash,
    type_support,
)

EMBEDDED = Path(rosidl_embedded.__file__).parent.parent

ODDS = """\
# All that a definition may hold.
string<=4 short "ab"   # bounded, with a default
wstring wide
wstring<=3 narrow
string[<=2] names
float32[2] pair [1.5, -2]
uint8[<=3] few [1, 2]
byte[] raw
bool[2] flags [true, false]
bool on true
char letter 65
int64 LOWEST = -9223372036854775808
string GREETING = "hello # not a comment"
string BARE=plain text
byte MARK=7
bool YES=true
geometry_msgs/Point[2] corners
Other other
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> str:
    """An interface package of a name of its own, in a folder of the interface path."""
    name = "odd_" + str(abs(hash(request.node.name)))
    (tmp_path / name / "msg").mkdir(parents=True)
    (tmp_path / name / "srv").mkdir()
    (tmp_path / name / "msg" / "Odds.msg").write_text(ODDS.replace(" # not a comment", ""), encoding="utf-8")
    (tmp_path / name / "msg" / "Other.msg").write_text("float64 x\n")
    (tmp_path / name / "srv" / "Ask.srv").write_text("Other question\n---\nuint8 OK=1\nOther[] answers\n")
    monkeypatch.setenv(catalogue.INTERFACE_PATH, str(tmp_path))
    return name


def test_import_of_a_package_without_python(package: str) -> None:
    messages = importlib.import_module(f"{package}.msg")
    services = importlib.import_module(f"{package}.srv")
    assert dir(messages) == ["Odds", "Other"]
    odds = messages.Odds()
    assert messages.Odds is messages.Odds
    assert (odds.short, odds.on, odds.letter) == ("ab", True, 65)
    assert odds.pair.tolist() == [1.5, -2.0]
    assert odds.few.tolist() == [1, 2]
    assert odds.flags == [True, False]
    assert (odds.LOWEST, odds.GREETING, odds.BARE) == (-(2**63), "hello", "plain text")
    assert (odds.MARK, odds.YES) == (b"\7", True)
    assert len(odds.corners) == 2
    assert services.Ask.Response.OK == 1
    assert services.Ask_Request is services.Ask.Request
    with pytest.raises(ImportError):
        importlib.import_module(f"{package}.action")
    with pytest.raises(AttributeError, match="has no 'Missing': no definition of"):
        _ = messages.Missing


def test_round_trip_of_odd_fields(package: str) -> None:
    cls = get_message(f"{package}/Odds")
    support = type_support(cls)
    message = cls(short="å", wide="wide 🚀", narrow="Ω", names=["a", ""], raw=[b"\1", b"\2"], flags=[False, True])
    assert support.deserialize(support.serialize(message)) == message
    assert support.type_hash.startswith("RIHS01_")
    with pytest.raises(AssertionError, match="string value not longer than 4"):
        message.short = "abcde"
    with pytest.raises(AssertionError, match="with length <= 2"):
        message.names = ["a"] * 3
    with pytest.raises(AssertionError, match="with length <= 3"):
        message.few = [1] * 4
    response = get_interface(f"{package}/srv/Ask").Response
    answer = response(answers=[get_message(f"{package}/Other")(x=1.0)])
    assert type_support(response).deserialize(type_support(response).serialize(answer)) == answer


def test_wide_string_takes_four_bytes_a_unit(package: str) -> None:
    # As rmw_cyclonedds writes it: number of UTF-16 units, each in four bytes, no terminator.
    cls = get_message(f"{package}/Odds")
    data = type_support(cls).serialize(cls(short="", wide="aΩ"))
    assert data[4:24] == bytes.fromhex("01000000 00000000 02000000 61000000 a9030000")


def test_interface_path_may_name_the_package_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "named_directly" / "msg").mkdir(parents=True)
    (tmp_path / "named_directly" / "msg" / "One.msg").write_text("int8 x 3\n")
    monkeypatch.setenv(catalogue.INTERFACE_PATH, str(tmp_path / "named_directly"))
    assert get_message("named_directly/msg/One")().x == 3


def test_share_of_a_ros_installation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "share" / "installed_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "share" / "installed_msgs" / "msg" / "One.msg").write_text("int8 x 4\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    assert get_message("installed_msgs/msg/One")().x == 4


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("float64", "'' is not a field's name"),
        ("float x", "'float' is neither a basic type"),
        ("float64 X", "'X' is not a field's name"),
        ("float64 x__y", "'x__y' is not a field's name"),
        ("float64 lambda", "'lambda' is not a field's name"),
        ("float64[ x", "'float64[' is not a type"),
        ("float64[0] x", "'float64[0]' is not a type"),
        ("float64[<=] x", "'float64[<=]' is not a type"),
        ("float64<=3 x", "'float64<=3' is not a type"),
        ("string<=0 x", "'string<=0' is not a type"),
        ("uint8 x 256", "256 is not a value of type uint8"),
        ("bool x maybe", "'maybe' is not a value"),
        ("uint8[2] x [1]", "1 values for an array of 2"),
        ("uint8[<=1] x [1, 2]", "2 values for a sequence of at most 1"),
        ("Other x 1", "a message field cannot have a default"),
        ("int8 lower=1", "'lower' is not a constant's name"),
        ("int8[2] A=1", "must be a number, a boolean or a string"),
        ("int8 A=1.5", "1.5 is not a value of type int8"),
    ],
)
def test_wrong_definition(text: str, reason: str) -> None:
    with pytest.raises(InvalidInterfaceError) as caught:
        parse_structure(f"# first line\n{text}", "pkg/msg/Name", "Name.msg")
    assert str(caught.value).startswith("Name.msg, line 2: ")
    assert reason in str(caught.value)


def test_field_defined_twice() -> None:
    with pytest.raises(InvalidInterfaceError, match="line 2: 'x' is defined twice"):
        parse_structure("int8 x\nint8 x", "pkg/msg/Name", "Name.msg")


@pytest.mark.parametrize("text", ["int8 x", "---\n---\n"])
def test_service_needs_two_parts(text: str) -> None:
    with pytest.raises(InvalidInterfaceError, match="needs exactly 1 x '---', between request and response"):
        split_parts(text, "pkg/srv/Name", "Name.srv", PARTS["srv"])


@pytest.mark.parametrize("text", ["", "int8 x\n---\nint8 y", "---\n---\n---"])
def test_an_action_has_three_parts(text: str) -> None:
    with pytest.raises(InvalidInterfaceError, match="exactly 2 x '---', between goal and result and feedback"):
        split_parts(text, "pkg/action/Name", "Name.action", PARTS["action"])


@pytest.mark.parametrize(("kind", "text"), [("srv", "int8 x\n---\nint8 Y\n"), ("action", "---\n---\nint8 Y\n")])
def test_errors_in_a_part_name_the_line_of_the_file(
    kind: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "wrong_msgs" / kind).mkdir(parents=True)
    (tmp_path / "wrong_msgs" / kind / f"One.{kind}").write_text(text)
    monkeypatch.setenv(catalogue.INTERFACE_PATH, str(tmp_path))
    with pytest.raises(InvalidInterfaceError, match=rf"One.{kind}, line 3: 'Y' is not a field's name"):
        get_interface(f"wrong_msgs/{kind}/One")


def test_actions_have_the_members_of_genuine_ones() -> None:
    from test_msgs.action import Fibonacci

    assert get_interface("test_msgs/action/Fibonacci") is Fibonacci
    assert Fibonacci.Impl.SendGoalService is get_interface("test_msgs/action/Fibonacci_SendGoal")
    assert Fibonacci.Impl.SendGoalService.Request().goal == Fibonacci.Goal()
    assert Fibonacci.Impl.GetResultService.Response(status=4, result=Fibonacci.Result(sequence=[1])).status == 4
    assert Fibonacci.Impl.FeedbackMessage().get_fields_and_field_types() == {
        "goal_id": "unique_identifier_msgs/UUID",
        "feedback": "test_msgs/Fibonacci_Feedback",
    }
    assert Fibonacci.Impl.CancelGoalService.__name__ == "CancelGoal"
    assert Fibonacci.Impl.GoalStatusMessage.__name__ == "GoalStatusArray"
    assert Fibonacci.__module__ == Fibonacci.Goal.__module__ == "test_msgs.action"
    with pytest.raises(NotImplementedError, match="Action classes can not be instantiated"):
        Fibonacci()


@pytest.mark.parametrize(
    "name", ["std_msgs/msg/Missing", "nowhere/msg/String", "String", "a/b/c", "std_srvs/srv/No_Request"]
)
def test_unknown_message(name: str) -> None:
    with pytest.raises(UnknownInterfaceError):
        get_message(name)
    with pytest.raises(UnknownInterfaceError):
        type_hash(name)


@pytest.mark.parametrize(
    ("content", "error", "reason"),
    [
        (b"float64 x\xff\n", InvalidInterfaceError, "One.msg cannot be read"),
        (b"One[] ones\n", InvalidInterfaceError, "contains itself: broken_msgs/msg/One > broken_msgs/msg/One"),
        (b"Gone gone\n", UnknownInterfaceError, "no definition of 'broken_msgs/msg/Gone'"),
    ],
)
def test_broken_package(
    content: bytes, error: type[Exception], reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "broken_msgs" / "msg" / "One.msg").write_bytes(content)
    monkeypatch.setenv(catalogue.INTERFACE_PATH, str(tmp_path))
    catalogue.structure.cache_clear()
    catalogue.interface.cache_clear()
    with pytest.raises(error, match=reason):
        get_message("broken_msgs/msg/One")


def test_service_and_message_are_not_confused() -> None:
    for name in ("std_srvs/srv/Trigger", "test_msgs/action/Fibonacci", "test_msgs/action/Fibonacci_SendGoal"):
        with pytest.raises(UnknownInterfaceError, match="is not a message"):
            get_message(name)
    with pytest.raises(TypeError, match="is not a message class"):
        type_support(get_interface("std_srvs/srv/Trigger"))
    for wrong in (int, "std_msgs/msg/String", None):
        with pytest.raises(TypeError):
            type_support(wrong)


def test_definition_text_holds_all_that_is_referred_to() -> None:
    # With the empty lines of the definitions that rosbag2 writes.
    bar = "\n" + "=" * 80
    assert interface_definition("sensor_msgs/msg/Temperature") == (
        "std_msgs/Header header\nfloat64 temperature\nfloat64 variance\n"
        f"{bar}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
        f"{bar}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    )


def test_definition_text_of_a_message_is_that_of_its_file(package: str, tmp_path: Path) -> None:
    text = f"\n# A comment.\n{package}/msg/Other other\n"
    (tmp_path / package / "msg" / "Named.msg").write_text(text)
    assert interface_definition(f"{package}/msg/Named").startswith(text + "\n=")


def test_definition_text_of_a_part_is_its_part_of_the_file(package: str) -> None:
    text = interface_definition(f"{package}/srv/Ask_Response")
    assert text.startswith("uint8 OK=1\nOther[] answers\n\n=") and f"MSG: {package}/Other\n" in text


def test_sources_of_a_service_are_its_file_and_what_it_refers_to() -> None:
    sources = type_sources("std_srvs/srv/SetBool")
    assert [(source["type_name"], source["encoding"]) for source in sources] == [
        ("std_srvs/srv/SetBool", "srv"),
        ("std_srvs/srv/SetBool_Event", "implicit"),
        ("service_msgs/msg/ServiceEventInfo", "msg"),
        ("builtin_interfaces/msg/Time", "msg"),
        ("std_srvs/srv/SetBool_Request", "implicit"),
        ("std_srvs/srv/SetBool_Response", "implicit"),
    ]
    texts = [source["raw_file_contents"] for source in sources]
    assert texts[0].split() == ["bool", "data", "---", "bool", "success", "string", "message"]
    assert texts[1] == texts[4] == texts[5] == ""


@pytest.mark.parametrize("name", ["rcl_interfaces/msg/ParameterEvent", "geometry_msgs/msg/PoseWithCovarianceStamped"])
def test_definition_text_reads_back(name: str) -> None:
    text = interface_definition(name).split("=" * 80)[0]
    assert parse_structure(text, name, "text") == catalogue.structure(name)


def test_definition_text_of_feedback_reads_recorded_feedback() -> None:
    name = "test_msgs/action/NestedMessage_FeedbackMessage"
    message = get_message(name)()
    message.feedback.nested_field.byte_value = b"\7"
    message.feedback.nested_different_pkg.sec = 9
    store = get_typestore(Stores.EMPTY)
    # rosbags knows messages only, but reads what mcap readers read.
    store.register(get_types_from_msg(interface_definition(name), name))
    read = store.deserialize_cdr(type_support(type(message)).serialize(message), name)
    assert read.feedback.nested_different_pkg.sec == 9
    assert read.feedback.nested_field.byte_value == 7
    assert interface_definition("test_msgs/action/Fibonacci_FeedbackMessage").startswith(
        "unique_identifier_msgs/UUID goal_id\ntest_msgs/Fibonacci_Feedback feedback\n"
    )


@pytest.mark.parametrize("name", ["test_msgs/srv/Arrays_Request", "rcl_interfaces/srv/ListParameters_Request"])
def test_definition_text_of_a_request_reads_back(name: str) -> None:
    read = parse_structure(interface_definition(name).split("=" * 80)[0], name, "text")
    expected = catalogue.structure(name)
    assert [(field.name, field.type) for field in read.fields] == [
        (field.name, field.type) for field in expected.fields
    ]
    assert read.constants == expected.constants


def test_common_messages_are_those_of_the_jazzy_type_store_of_rosbags() -> None:
    jazzy = get_typestore(Stores.ROS2_JAZZY)
    # rosbags takes the uint8 that is written "char" for another type; all such types are among the recorded ones.
    recorded = json.loads((Path(__file__).parent / "data" / "golden_cdr.json").read_text())["type_hashes"]
    for name, (constants, _) in jazzy.fielddefs.items():
        assert type_hash(name) == recorded.get(name, jazzy.hash_rihs01(name))
        held = [(constant.name, constant.value) for constant in catalogue.structure(name).constants]
        assert held == [(key, bytes([value]) if kind == "byte" else value) for key, kind, value in constants]


def test_rosbags_reads_the_definition_texts() -> None:
    jazzy = get_typestore(Stores.ROS2_JAZZY)
    names = [*jazzy.fielddefs, *(f"fsw_msgs/msg/{name}" for name in search.definitions("fsw_msgs", "msg"))]
    hashes = {}
    for name in names:
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(interface_definition(name), name))
        hashes[name] = store.hash_rihs01(name)
    assert hashes == {name: type_hash(name) for name in names}


def test_field_names_that_python_or_the_generated_code_uses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = (
        "self",
        "property",
        "array",
        "types",
        "unknown",
        "value",
        "range",
        "hasattr",
        "zeros",
        "isinstance",
        "other",
    )
    (tmp_path / "clashes" / "msg").mkdir(parents=True)
    (tmp_path / "clashes" / "msg" / "All.msg").write_text(
        "".join(f"float32[] {name}\nint8[2] {name}2\n" for name in names)
    )
    monkeypatch.setenv(catalogue.INTERFACE_PATH, str(tmp_path))
    cls = get_message("clashes/msg/All")
    message = cls(**{name: [1.0] for name in names})
    message.self2 = [1, 2]
    assert message != cls()
    assert type_support(cls).deserialize(type_support(cls).serialize(message)) == message


def test_own_interfaces_come_from_their_files() -> None:
    from fsw_msgs.msg import SupervisorState, WeldCommand
    from fsw_msgs.srv import SwitchController

    state = SupervisorState(applied=WeldCommand(axial_force=78.4e3))
    support = type_support(SupervisorState)
    assert support.deserialize(support.serialize(state)) == state
    assert SwitchController.Request.STRICT == 2
    assert support.dds_name == "fsw_msgs::msg::dds_::SupervisorState_"


MESSAGES_FIRST = """
from plain_msgs.msg import Plain
from plain_msgs.srv import Plain as Service
import rclpy
print(Plain(depth=0.5).depth, Service.Response().done)
"""


def run_python(code: str, **environ: str) -> str:
    """Run a program that finds this runtime as an environment with its ``.pth`` file does; return what it prints."""
    code = f"import sys; sys.path.append({str(EMBEDDED)!r}); import rosidl_embedded\n{code}"
    run = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, env={**os.environ, **environ}
    )
    return run.stdout or run.stderr


@pytest.fixture
def plain_msgs(tmp_path: Path) -> Path:
    """A folder with the package ``plain_msgs``, which has a message and a service."""
    for kind, text in (("msg", "float64 depth"), ("srv", "---\nbool done")):
        (tmp_path / "plain_msgs" / kind).mkdir(parents=True)
        (tmp_path / "plain_msgs" / kind / f"Plain.{kind}").write_text(text)
    return tmp_path


@pytest.mark.parametrize("where", ["above", "itself", "python package", "interface path", "installation"])
def test_own_package_can_be_imported_before_rclpy(where: str, plain_msgs: Path) -> None:
    environ = {"PYTHONPATH": str(plain_msgs)}
    if where == "itself":
        environ = {"PYTHONPATH": str(plain_msgs / "plain_msgs")}
    elif where == "python package":
        (plain_msgs / "plain_msgs" / "__init__.py").write_text("")
    elif where == "interface path":
        environ = {search.INTERFACE_PATH: str(plain_msgs)}
    elif where == "installation":
        (plain_msgs / "share").mkdir()
        (plain_msgs / "plain_msgs").rename(plain_msgs / "share" / "plain_msgs")
        environ = {"AMENT_PREFIX_PATH": str(plain_msgs)}
    assert run_python(MESSAGES_FIRST, **environ) == "0.5 False\n"


@pytest.mark.parametrize("package", ["plain_msgs", "std_msgs"])
def test_generated_packages_win(package: str, plain_msgs: Path) -> None:
    (plain_msgs / package / "msg").mkdir(parents=True, exist_ok=True)
    (plain_msgs / package / "__init__.py").write_text("")
    (plain_msgs / package / "msg" / "__init__.py").write_text("Plain = 'generated'")
    assert run_python(f"from {package}.msg import Plain; print(Plain)", PYTHONPATH=str(plain_msgs)) == "generated\n"


def test_nothing_is_found_beside_a_genuine_rclpy(plain_msgs: Path) -> None:
    (plain_msgs / "rclpy").mkdir()
    (plain_msgs / "rclpy" / "__init__.py").write_text("")
    assert "No module named 'std_msgs'" in run_python("import std_msgs.msg", PYTHONPATH=str(plain_msgs))
    assert "cannot import name 'Plain'" in run_python("from plain_msgs.msg import Plain", PYTHONPATH=str(plain_msgs))


def test_this_environment_imports_messages_first() -> None:
    code = "from std_msgs.msg import String; import rclpy; print(String(data='x').data)"
    modules = subprocess.check_output([sys.executable, "-c", "import sys; print(*sys.modules)"], text=True)
    if "rosidl_embedded" not in modules:
        pytest.skip("not installed into this Python, only on its path")
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "x\n"


def test_other_imports_look_into_no_folder() -> None:
    code = """
finder = sys.meta_path[0]
finder.find_spec("wave")
looked = []
sys.addaudithook(lambda event, _: looked.append(event) if event in ("open", "os.listdir", "os.scandir") else None)
for _ in range(100):
    finder.find_spec("wave")
print(looked)
"""
    assert run_python(code) == "[]\n"


def test_importing_messages_is_quick_and_builds_none() -> None:
    code = (
        "import sys, std_msgs.msg as m; "
        "assert not any('rosbags' in name or name == 'numpy' for name in sys.modules); "
        "assert not [name for name in vars(m) if name[0].isupper()]"
    )
    subprocess.run([sys.executable, "-c", f"import sys; sys.path.insert(0, {str(EMBEDDED)!r}); {code}"], check=True)


def test_star_import() -> None:
    namespace: dict[str, Any] = {}
    exec("from std_srvs.srv import *", namespace)
    assert {"Empty", "SetBool", "Trigger"} <= set(namespace)


def test_stubs_show_the_fields_and_constants_of_the_classes(package: str, tmp_path: Path) -> None:
    stubs.write(package, tmp_path)
    stubs.write("std_srvs", tmp_path)
    assert (tmp_path / "std_srvs-stubs" / "py.typed").is_file()
    for path in tmp_path.glob("*-stubs/*/*.pyi"):
        name, kind = path.parts[-3].removesuffix("-stubs"), path.parts[-2]
        shown = {node.name: node for node in ast.parse(path.read_text()).body if isinstance(node, ast.ClassDef)}
        assert set(shown) >= set(search.definitions(name, kind))
        for class_name, node in shown.items():
            if kind == "msg" or "_" in class_name:
                cls = get_message(f"{name}/{kind}/{class_name}")
                members = {getattr(item, "name", None) or item.target.id for item in node.body}  # type: ignore[attr-defined]
                expected = {*cls.get_fields_and_field_types(), *catalogue.structure(cls._TYPE_NAME).values()}
                assert members == expected | {"SLOT_TYPES", "__init__", "get_fields_and_field_types"}


def test_command_writes_stubs_of_common_and_own_packages(plain_msgs: Path) -> None:
    command = [sys.executable, "-m", "rosidl_embedded.stubs", "--into", "stubs", str(plain_msgs)]
    environ = {**os.environ, "PYTHONPATH": str(EMBEDDED)}
    subprocess.run(command, check=True, cwd=plain_msgs, env=environ)
    written = {path.name.removesuffix("-stubs") for path in (plain_msgs / "stubs").iterdir()}
    assert written == search.COMMON_PACKAGES | {"plain_msgs"}
    assert "depth: float" in (plain_msgs / "stubs" / "plain_msgs-stubs" / "msg" / "__init__.pyi").read_text()


def test_examples_and_composition_have_the_hashes_of_jazzy() -> None:
    # Of a genuine Jazzy, as colcon wrote them; those of the other packages are in golden_cdr.json.
    recorded = json.loads((Path(__file__).parent / "data" / "golden_hashes.json").read_text())
    assert len(recorded) > 30
    assert {name: type_hash(name) for name in recorded} == recorded
