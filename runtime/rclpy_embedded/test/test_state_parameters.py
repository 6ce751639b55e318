"""Parameters, the store of a node, and its services."""

import array
import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterEvent,
    ParameterType,
    ParameterValue,
    SetParametersResult,
)
from rcl_interfaces.msg import Parameter as ParameterMsg
from rcl_interfaces.srv import GetParameters, GetParameterTypes, ListParameters, SetParametersAtomically
from rclpy.exceptions import (
    InvalidParameterException,
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterAlreadyDeclaredException,
    ParameterImmutableException,
    ParameterNotDeclaredException,
    ParameterUninitializedException,
)
from rclpy.parameter import Parameter, get_parameter_value, parameter_dict_from_yaml_file, parameter_value_to_python
from rclpy.parameter_service import ParameterService
from rclpy.parameter_store import ParameterStore

from rosidl_embedded.typesupport import type_support

Type = Parameter.Type
INT64 = st.integers(-(2**63), 2**63 - 1)
DOUBLE = st.floats(allow_nan=False)
NAME = st.from_regex(r"[a-c](\.[a-c]){0,3}", fullmatch=True)
VALUES = st.one_of(
    st.booleans(),
    INT64,
    DOUBLE,
    st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=8),
    st.lists(st.booleans(), min_size=1, max_size=4),
    st.lists(INT64, min_size=1, max_size=4),
    st.lists(DOUBLE, min_size=1, max_size=4),
    st.lists(st.text("abc", max_size=3), min_size=1, max_size=4),
    st.lists(st.binary(min_size=1, max_size=1), min_size=1, max_size=4),
)


class Events(list[ParameterEvent]):
    """The published events, as names."""

    def names(self) -> list[tuple[list[str], list[str], list[str]]]:
        return [
            tuple(
                [parameter.name for parameter in parameters]
                for parameters in (event.new_parameters, event.changed_parameters, event.deleted_parameters)
            )
            for event in self
        ]


def make_store(**kwargs: object) -> tuple[ParameterStore, Events]:
    events = Events()
    return ParameterStore(publish_event=events.append, **kwargs), events


@given(VALUES)
def test_values_survive_their_message(value: object) -> None:
    parameter = Parameter("p", value=value)
    message = parameter.to_parameter_msg()
    back = Parameter.from_parameter_msg(message)
    assert (back.name, back.type_) == ("p", parameter.type_)
    assert parameter_value_to_python(message.value) == value


def test_types_have_the_numbers_of_the_message() -> None:
    for type_ in Type:
        assert type_.value == getattr(ParameterType, f"PARAMETER_{type_.name}")


@pytest.mark.parametrize(
    ("value", "type_"),
    [
        (None, Type.NOT_SET),
        (True, Type.BOOL),
        (array.array("d", [1.0]), Type.DOUBLE_ARRAY),
        ((1, 2), Type.INTEGER_ARRAY),
    ],
)
def test_type_of_a_value(value: object, type_: Type) -> None:
    assert Type.from_parameter_value(value) is type_
    assert Parameter("p", type_, value).type_ is type_


@pytest.mark.parametrize("value", [object(), {"a": 1}, [1, "a"], [1, 2.0], b"ab", 1j])
def test_values_that_no_parameter_can_have(value: object) -> None:
    with pytest.raises(TypeError, match="The given value is not"):
        Parameter("p", value=value)


def test_type_and_value_must_agree() -> None:
    with pytest.raises(ValueError, match="do not agree"):
        Parameter("p", Type.INTEGER, "1")
    with pytest.raises(TypeError, match="type must be an instance of"):
        Parameter("p", 2, 1)
    assert Parameter("p", Type.STRING_ARRAY, []).get_parameter_value().type == ParameterType.PARAMETER_STRING_ARRAY


def test_unknown_type_in_a_message() -> None:
    with pytest.raises(ValueError):
        Parameter.from_parameter_msg(ParameterMsg(name="p", value=ParameterValue(type=99)))
    with pytest.raises(RuntimeError, match="unexpected parameter type 99"):
        parameter_value_to_python(ParameterValue(type=99))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("true", True),
        ("1", 1),
        ("1.5", 1.5),
        ("[1, 2]", [1, 2]),
        ("[1, a]", "[1, a]"),
        ("", ""),
        ("a: [", "a: ["),
        ("{}", "{}"),
    ],
)
def test_value_from_text(text: str, value: object) -> None:
    assert parameter_value_to_python(get_parameter_value(text)) == value


def test_parameter_file(tmp_path: object) -> None:
    path = str(tmp_path / "p.yaml")
    with open(path, "w") as stream:
        stream.write("/**: {ros__parameters: {a: 1, b: 1}}\n/n: {ros__parameters: {a: 2, c: {d: [x]}}}\nm: 1\n")
    read = parameter_dict_from_yaml_file(path, True, ["/n"], "ns.")
    assert {name: parameter_value_to_python(msg.value) for name, msg in read.items()} == {
        "ns.a": 2,
        "ns.b": 1,
        "ns.c.d": ["x"],
    }
    with pytest.raises(RuntimeError, match="does not contain parameters for /x"):
        parameter_dict_from_yaml_file(path, target_nodes=["/x"])
    with pytest.raises(RuntimeError, match="not a valid ROS parameter file for node m"):
        parameter_dict_from_yaml_file(path)
    for text in ("", "m"):
        with open(path, "w") as stream:
            stream.write(text)
        with pytest.raises(RuntimeError, match="must be a mapping"):
            parameter_dict_from_yaml_file(path)


# -- the store ----------------------------------------------------------------------------------------------------


def test_declaring_gives_default_or_override() -> None:
    store, events = make_store(overrides={"a": Parameter("a", value=5), "ns.b": Parameter("ns.b", value="over")})
    assert store.declare_parameter("a", 1).value == 5
    assert store.declare_parameters("ns", [("b", "x"), ("c", Type.DOUBLE)])[0].value == "over"
    assert store.declare_parameter("d", 2.0, ignore_override=True).value == 2.0
    assert store.declare_parameter("e", ParameterValue(type=2, integer_value=3)).value == 3
    assert events.names() == [([name], [], []) for name in ("a", "ns.b", "ns.c", "d", "e")]
    assert store.get_parameter_types(["a", "ns.b"]) == [Type.INTEGER.value, Type.STRING.value]


def test_declaring_what_cannot_be_declared() -> None:
    store, events = make_store(overrides={"typed": Parameter("typed", value="text")})
    store.declare_parameter("a", 1)
    with pytest.raises(ParameterAlreadyDeclaredException, match=r"already declared: \['a'\]"):
        store.declare_parameters("", [("b", 1), ("a", 1)])
    with pytest.raises(InvalidParameterException, match="Invalid parameter name"):
        store.declare_parameter("", 1)
    with pytest.raises(
        InvalidParameterTypeException, match="'typed' to 'text' of type 'STRING', expecting type 'INTEGER'"
    ):
        store.declare_parameter("typed", 1)
    with pytest.raises(ValueError, match="as statically typed of type NOT_SET"):
        store.declare_parameter("c", Type.NOT_SET)
    with pytest.raises(ValueError, match="Cannot declare a statically typed parameter with default"):
        store.declare_parameter("c", None, ParameterDescriptor())
    with pytest.raises(ValueError, match="is not allowed when the parameter type is provided"):
        store.declare_parameter("c", Type.INTEGER, ParameterDescriptor(dynamic_typing=True))
    for entry, text in (
        ((), "tuple length"),
        (("x", 1, ParameterDescriptor(), 1), "tuple length"),
        ((1, 2), "is not a str"),
        (("x", 1, "d"), "is not a ParameterDescriptor"),
    ):
        with pytest.raises(TypeError, match=text):
            store.declare_parameters("", [entry])
    assert not store.has_parameter("b")
    assert len(events) == 1


def test_declaring_a_name_only_is_deprecated() -> None:
    store, _ = make_store()
    with pytest.warns(UserWarning, match="declaring a parameter only providing its name is deprecated"):
        assert store.declare_parameter("a").type_ is Type.NOT_SET
    assert store.describe_parameter("a").dynamic_typing


def test_reading() -> None:
    store, _ = make_store()
    store.declare_parameters("", [("foo.a", 1), ("foo.b", 2), ("foobar.c", 3), ("unset", Type.STRING)])
    assert [parameter.value for parameter in store.get_parameters(["foo.b", "foo.a"])] == [2, 1]
    assert {name: p.value for name, p in store.get_parameters_by_prefix("foo").items()} == {"a": 1, "b": 2}
    assert len(store.get_parameters_by_prefix("")) == 4
    with pytest.raises(ParameterUninitializedException, match="The parameter 'unset' is not initialized"):
        store.get_parameter("unset")
    alternative = Parameter("unset", value="x")
    assert store.get_parameter_or("unset", alternative) is alternative
    assert store.get_parameter_or("nowhere").type_ is Type.NOT_SET
    assert store.get_parameter_or("foo.a", alternative).value == 1
    with pytest.raises(ParameterNotDeclaredException, match="undeclared parameter"):
        store.get_parameter("nowhere")
    with pytest.raises(ParameterNotDeclaredException):
        store.get_parameter_type("nowhere")
    with pytest.raises(TypeError, match="All names must be instances of type str"):
        store.get_parameters([1])


def test_undeclared_parameters_where_they_are_allowed() -> None:
    store, events = make_store(allow_undeclared=True)
    assert store.get_parameter("a").type_ is store.get_parameter_type("a") is Type.NOT_SET
    assert store.describe_parameter("a") == ParameterDescriptor()
    for value in (1, "now a text"):
        assert store.set_parameters([Parameter("a", value=value)])[0].successful
    assert store.describe_parameter("a").dynamic_typing
    assert store.set_parameters_atomically([Parameter("a")]).successful
    assert not store.has_parameter("a")
    assert events.names() == [(["a"], [], []), ([], ["a"], []), ([], [], ["a"])]


def test_static_typing() -> None:
    store, events = make_store()
    store.declare_parameter("a", 1)
    result = store.set_parameters([Parameter("a", value=1.0)])[0]
    assert result.reason == "Wrong parameter type, expected 'Type.INTEGER' got 'Type.DOUBLE'"
    assert store.set_parameters([Parameter("a")])[0].reason == "Static parameter cannot be undeclared"
    with pytest.raises(ParameterNotDeclaredException, match=r"\['b', 'c'\]"):
        store.set_parameters_atomically([Parameter("a", value=2), Parameter("b", value=2), Parameter("c", value=2)])
    with pytest.raises(TypeError, match="parameter must be instance of type"):
        store.set_parameters_atomically([1])
    assert store.get_parameter("a").value == 1
    assert len(events) == 1


def test_read_only_and_undeclaring() -> None:
    store, _ = make_store()
    store.declare_parameter("fixed", 1, ParameterDescriptor(read_only=True))
    store.declare_parameter("free", 1)
    assert (
        store.set_parameters([Parameter("fixed", value=2)])[0].reason == "Trying to set a read-only parameter: fixed."
    )
    with pytest.raises(ParameterImmutableException):
        store.undeclare_parameter("fixed")
    with pytest.raises(ParameterImmutableException):
        store.set_descriptor("fixed", ParameterDescriptor())
    store.undeclare_parameter("free")
    with pytest.raises(ParameterNotDeclaredException):
        store.undeclare_parameter("free")


def test_setting_atomically_is_all_or_nothing() -> None:
    store, events = make_store()
    store.declare_parameters("", [("a", 1), ("b", 1)])
    assert not store.set_parameters_atomically([Parameter("a", value=2), Parameter("b", value="x")]).successful
    assert [p.value for p in store.get_parameters(["a", "b"])] == [1, 1]
    assert store.set_parameters_atomically([Parameter("a", value=2), Parameter("b", value=3)]).successful
    assert events.names()[-1] == ([], ["a", "b"], [])
    assert [p.value for p in store.get_parameters(["a", "b"])] == [2, 3]


@given(st.integers(-20, 20), st.integers(-20, 20), st.integers(0, 5), st.integers(-30, 30))
def test_integer_ranges(one: int, other: int, step: int, value: int) -> None:
    store, _ = make_store()
    low, high = sorted((one, other))
    allowed = IntegerRange(from_value=one, to_value=other, step=step)
    store.declare_parameter("a", low, ParameterDescriptor(integer_range=[allowed]))
    expected = value in (low, high) or (low < value < high and (step == 0 or (value - low) % step == 0))
    result = store.set_parameters([Parameter("a", value=value)])[0]
    assert result.successful is expected
    assert (store.get_parameter("a").value == value) is (expected or value == low)
    if not expected:
        assert str(value) in result.reason and f"Min: {low}" in result.reason


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, ""),
        (10.0, ""),
        (9.999999999, ""),
        (2.5, ""),
        (10.5, "out of range"),
        (-0.1, "out of range"),
        (2.6, "valid step"),
    ],
)
def test_floating_point_ranges(value: float, text: str) -> None:
    store, _ = make_store()
    allowed = FloatingPointRange(from_value=0.0, to_value=10.0, step=0.5)
    store.declare_parameter("a", 1.0, ParameterDescriptor(floating_point_range=[allowed]))
    result = store.set_parameters([Parameter("a", value=value)])[0]
    assert result.successful is not bool(text)
    assert text in result.reason


def test_not_a_number_is_outside_every_range() -> None:
    store, _ = make_store()
    allowed = FloatingPointRange(from_value=0.0, to_value=1.0)
    store.declare_parameter("a", 1.0, ParameterDescriptor(floating_point_range=[allowed]))
    assert "out of range" in store.set_parameters([Parameter("a", value=float("nan"))])[0].reason
    with pytest.raises(
        InvalidParameterValueException, match=r"\(2\.0\) for parameter\. Reason: Parameter b out of range"
    ):
        store.declare_parameter("b", 2.0, ParameterDescriptor(floating_point_range=[allowed]))


def test_new_descriptors() -> None:
    store, _ = make_store()
    store.declare_parameter("a", 50)
    small = ParameterDescriptor(type=2, integer_range=[IntegerRange(from_value=0, to_value=10)])
    with pytest.raises(InvalidParameterValueException, match="out of range"):
        store.set_descriptor("a", small)
    assert store.describe_parameter("a").integer_range == []
    value = store.set_descriptor("a", small, ParameterValue(type=2, integer_value=5))
    assert value.integer_value == store.get_parameter("a").value == 5
    assert store.describe_parameter("a").name == "a"
    with pytest.raises(ParameterNotDeclaredException):
        store.set_descriptor("b", small)


def test_callbacks_run_in_order_and_can_change_refuse_and_learn() -> None:
    store, events = make_store()
    log: list[str] = []

    def on_set(label: str, successful: bool = True) -> object:
        def callback(parameters: list[Parameter]) -> SetParametersResult:
            log.append(label + ",".join(f"{p.name}={p.value}" for p in parameters))
            return SetParametersResult(successful=successful, reason=label)

        return callback

    first, second = on_set("first "), on_set("second ")
    store.add_on_set_parameters_callback(first)
    store.add_on_set_parameters_callback(second)
    store.add_post_set_parameters_callback(lambda parameters: log.append(f"post {store.get_parameter('a').value}"))
    store.declare_parameter("a", 1)
    assert log == ["second a=1", "first a=1", "post 1"]

    log.clear()
    pre = lambda parameters: [Parameter("a", value=p.value * 2) for p in parameters]  # noqa: E731
    store.add_pre_set_parameters_callback(pre)
    assert store.set_parameters([Parameter("a", value=4)])[0].successful
    assert log == ["second a=8", "first a=8", "post 8"]

    log.clear()
    store.add_on_set_parameters_callback(on_set("no ", False))
    assert store.set_parameters([Parameter("a", value=5)])[0].reason == "no "
    assert log == ["no a=10"] and store.get_parameter("a").value == 8 and len(events) == 2
    with pytest.raises(InvalidParameterValueException, match="Reason: no "):
        store.declare_parameter("b", 1)

    store.remove_pre_set_parameters_callback(pre)
    store.remove_on_set_parameters_callback(first)
    with pytest.raises(ValueError):
        store.remove_on_set_parameters_callback(first)
    store.add_pre_set_parameters_callback(lambda parameters: [])
    assert "parameter list cannot be empty" in store.set_parameters([Parameter("a", value=5)])[0].reason


def test_a_callback_may_set_other_parameters() -> None:
    store, events = make_store()
    store.declare_parameters("", [("a", 1), ("double", 2)])

    def follow(parameters: list[Parameter]) -> None:
        if parameters[0].name == "a":
            store.set_parameters([Parameter("double", value=2 * parameters[0].value)])

    store.add_post_set_parameters_callback(follow)
    store.set_parameters([Parameter("a", value=4)])
    assert store.get_parameter("double").value == 8
    assert events.names()[2:] == [([], ["a"], []), ([], ["double"], [])]


@given(st.lists(NAME, unique=True, max_size=10), st.lists(NAME, max_size=2), st.integers(0, 4))
def test_listing(names: list[str], prefixes: list[str], depth: int) -> None:
    store, _ = make_store()
    store.declare_parameters("", [(name, 1) for name in names])

    def wanted(name: str) -> bool:
        parts = name.split(".")
        if not prefixes:
            return depth == 0 or len(parts) <= depth
        rests = [parts[len(p.split(".")) :] for p in prefixes if parts[: len(p.split("."))] == p.split(".")]
        return any(depth == 0 or len(rest) <= depth for rest in rests)

    result = store.list_parameters(prefixes, depth)
    assert result.names == [name for name in names if wanted(name)]
    assert set(result.prefixes) == {name.rpartition(".")[0] for name in result.names if "." in name}


def test_listing_checks_its_arguments() -> None:
    store, _ = make_store()
    for arguments in ((("a",), 0), ([1], 0), ([], "0")):
        with pytest.raises(TypeError):
            store.list_parameters(*arguments)
    with pytest.raises(ValueError, match="greater than or equal to zero"):
        store.list_parameters([], -1)


def test_the_events_of_a_node_are_those_captured_from_a_genuine_one() -> None:
    samples = json.loads((Path(__file__).parent / "data" / "golden_wire.json").read_text())["samples"]
    support = type_support(ParameterEvent)
    captured = [bytes.fromhex(sample["bytes"]) for sample in samples if sample["topic"] == "rt/parameter_events"]
    captured = [data for data in captured if support.deserialize(data).node == "/srv_node"]

    store, events = make_store()
    store.declare_parameter("use_sim_time", False)
    store.declare_parameter("start_type_description_service", True)
    store.declare_parameter("gain", 1.5)
    store.set_parameters([Parameter("gain", value=2.5)])
    assert len(events) == len(captured) == 4
    for event, data in zip(events, captured, strict=True):
        event.node, event.stamp = "/srv_node", support.deserialize(data).stamp
        made = support.serialize(event)
        # On the wire the payload is padded with zeros to a multiple of four.
        assert made + bytes(len(data) - len(made)) == data


# -- the services -------------------------------------------------------------------------------------------------


class ServiceNode(ParameterStore):
    """A store that keeps the services created on it."""

    def __init__(self) -> None:
        super().__init__()
        self.services: dict[str, SimpleNamespace] = {}

    def get_name(self) -> str:
        return "node"

    def create_service(self, kind: type, name: str, callback: object, *, qos_profile: object) -> None:
        self.services[name] = SimpleNamespace(kind=kind, callback=callback, depth=qos_profile.depth)

    def call(self, name: str, request: object) -> object:
        service = self.services[f"node/{name}"]
        return service.callback(request, service.kind.Response())


def test_services() -> None:
    node = ServiceNode()
    service = ParameterService(node)
    assert sorted(node.services) == [
        "node/describe_parameters",
        "node/get_parameter_types",
        "node/get_parameters",
        "node/list_parameters",
        "node/set_parameters",
        "node/set_parameters_atomically",
    ]
    assert {entry.depth for entry in node.services.values()} == {1000}
    node.declare_parameters("", [("a", 1), ("b.c", "x"), ("unset", Type.STRING)])

    names = GetParameters.Request(names=["b.c", "a"])
    assert [parameter_value_to_python(value) for value in node.call("get_parameters", names).values] == ["x", 1]
    assert node.call("describe_parameters", names).descriptors[1].name == "a"
    assert list(node.call("get_parameter_types", GetParameterTypes.Request(names=["a"])).types) == [2]
    for missing in (["a", "nowhere"], ["unset"]):
        assert node.call("get_parameters", GetParameters.Request(names=missing)).values == []
    assert list(node.call("get_parameter_types", GetParameterTypes.Request(names=["nowhere"])).types) == []
    listed = node.call("list_parameters", ListParameters.Request(prefixes=["b"], depth=0)).result
    assert (listed.names, listed.prefixes) == (["b.c"], ["b"])

    def setting(**values: object) -> SetParametersAtomically.Request:
        messages = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        return SetParametersAtomically.Request(parameters=messages)

    assert node.call("set_parameters_atomically", setting(a=2)).result.successful
    results = node.call("set_parameters", setting(a=3, nowhere=1)).results
    assert [result.successful for result in results] == [True, False]
    assert "undeclared parameter" in results[1].reason
    unknown = SetParametersAtomically.Request(parameters=[ParameterMsg(name="a", value=ParameterValue(type=77))])
    assert "77" in node.call("set_parameters_atomically", unknown).result.reason
    assert node.get_parameter("a").value == 3

    del node
    with pytest.raises(ReferenceError):
        service._get_parameters_callback(names, GetParameters.Response())
