"""Makes message and service classes that behave as those of rosidl's Python generator.

The source of a class is generated and compiled when the class is first asked for.

Fields are checked when they are assigned. ``ROS_PYTHON_CHECK_FIELDS=0``, ``python -O``
or ``check_fields=False`` at construction turn this off.
"""

import copy
import math
from array import array
from operator import attrgetter
from threading import RLock
from typing import Any, NoReturn, cast

from . import catalogue
from . import definition as d
from .checks import CHECK_FIELDS, SEQUENCES, checks, packed_array, packed_sequence

_lock = RLock()
_classes: dict[str, type] = {}
_pending: list[str] = []
_DEFAULTS = {"bool": "False", "bytes": repr(bytes(1)), "float": "0.0", "int": "0", "str": "''"}


def get_message(type_name: str) -> Any:
    """Class of ``std_msgs/msg/String``, ``std_msgs/String`` or ``std_srvs/srv/Trigger_Request``."""
    if catalogue.role("/".join(catalogue.split_name(type_name))) != "message":
        raise d.UnknownInterfaceError(f"{type_name!r} is not a message")
    return get_interface(type_name)


def get_interface(type_name: str) -> Any:
    """Class of a message, a service (with Request, Response, Event) or an action (with Goal, Result, Feedback, Impl).

    Raises d.UnknownInterfaceError if there is none, d.InvalidInterfaceError if its definition is wrong.
    """
    full_name = "/".join(catalogue.split_name(type_name))
    with _lock:
        if full_name not in _classes:
            if full_name in _pending:
                raise d.InvalidInterfaceError(f"{full_name} contains itself: {' > '.join([*_pending, full_name])}")
            _pending.append(full_name)
            try:
                make = _make_message if catalogue.role(full_name) == "message" else _make_whole
                _classes[full_name] = make(catalogue.structure(full_name))
            finally:
                _pending.pop()
        return _classes[full_name]


def field_type_text(type_: d.AbstractType) -> str:
    """Type as ``get_fields_and_field_types()`` shows it: ``double[3]``, ``sequence<std_msgs/Header>``."""
    match type_:
        case d.BasicType(typename):
            return typename
        case d.NamespacedType():
            return f"{type_.namespaces[0]}/{type_.name}"
        case d.Array(element, size):
            return f"{field_type_text(element)}[{size}]"
        case d.BoundedSequence(element, bound):
            return f"sequence<{field_type_text(element)}, {bound}>"
        case d.AbstractSequence(value_type=element):
            return f"sequence<{field_type_text(element)}>"
    text = "wstring" if isinstance(type_, d.AbstractWString) else "string"
    return f"{text}<{type_.maximum_size}>" if isinstance(type_, d.BoundedString | d.BoundedWString) else text


def _refuse(self: object) -> NoReturn:
    raise NotImplementedError(f"{'Action' if hasattr(self, 'Impl') else 'Service'} classes can not be instantiated")


def _make_whole(definition: d.Structure) -> type:
    """Make the class of a service or an action."""
    type_name = definition.type_name
    package, kind, name = type_name.split("/")
    module = {"__module__": f"{package}.{kind}"}
    properties: dict[str, Any] = {"_TYPE_NAME": type_name, **module}
    attributes = catalogue.attributes(type_name)
    if event := attributes.pop("Event", None):
        # Only service introspection uses it, so it is made when it is asked for.
        properties["Event"] = property(lambda cls: get_message(event))
    members: dict[str, Any] = {key: get_message(value) for key, value in attributes.items()}
    if catalogue.role(type_name) == "action":
        impl = {key: get_interface(value) for key, value in catalogue.implementation(type_name).items()}
        members["Impl"] = type("Impl", (), {**impl, **module})
    metaclass = type(f"Metaclass_{name}", (type,), properties)
    return cast(type, metaclass(name, (), {"__init__": _refuse, **members, **module}))


class _Message:
    """What all message classes have."""

    __slots__ = ()
    _fields_and_field_types: dict[str, str]

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        return dict(cls._fields_and_field_types)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, type(self)):
            return False
        comparisons = (getattr(self, name) == getattr(other, name) for name in self._fields_and_field_types)
        # Arrays of numpy are compared element by element.
        return all(equal if isinstance(equal, bool) else equal.all() for equal in comparisons)

    def __repr__(self) -> str:
        texts = []
        for name in self._fields_and_field_types:
            value = getattr(self, name)
            texts.append(f"{name}={value.tolist() if isinstance(value, array) else value!r}")
        return f"{type(self).__module__}.{type(self).__name__}({', '.join(texts)})"


def _make_message(definition: d.Structure) -> type:
    package, kind, name = definition.type_name.split("/")
    module = {"__module__": f"{package}.{kind}"}
    fields = definition.fields
    values = definition.values()
    functions = _functions(definition)
    members = {
        "__doc__": f"Message class '{name}'.",
        "__slots__": [*(f"_{field.name}" for field in fields), "_check_fields"],
        "_fields_and_field_types": {field.name: field_type_text(field.type) for field in fields},
        "SLOT_TYPES": tuple(field.type for field in fields),
        "__init__": functions["__init__"],
    }
    for field in fields:
        setter, text = functions[f"set_{field.name}"], f"Message field '{field.name}'."
        members[field.name] = property(attrgetter(f"_{field.name}"), setter, doc=text)
    # Read-only on the class by a property of its metaclass; a plain attribute for its instances.
    properties = {key: _read_only(value) for key, value in values.items()}
    metaclass = type(f"Metaclass_{name}", (type,), {**properties, "_TYPE_NAME": definition.type_name, **module})
    return cast(type, metaclass(name, (_Message,), {**values, **members, **module}))


def _read_only(value: Any) -> property:
    return property(lambda cls: copy.copy(value))


def _reject(unknown: dict[str, Any]) -> NoReturn:
    raise AssertionError(f"Invalid arguments passed to constructor: {', '.join(sorted(unknown))}")


def _functions(definition: d.Structure) -> dict[str, Any]:
    """Compile the constructor ``__init__`` and a function ``set_<name>`` for every field."""
    # In capitals, because arguments of the constructor have the names of fields.
    namespace: dict[str, Any] = {
        "UNSET": object(),
        "CHECK": CHECK_FIELDS,
        "HASATTR": hasattr,
        "ISINF": math.isinf,
        "RANGE": range,
        "ARRAY": array,
        "SEQUENCES": SEQUENCES,
        "PACKED_SEQUENCE": packed_sequence,
        "PACKED_ARRAY": packed_array,
        "REJECT": _reject,
        "TYPES": {field.name: field.type for field in definition.fields},
    }
    arguments = "".join(f"{field.name}=UNSET, " for field in definition.fields)
    constructor = [
        f"def __init__(_self, *, {arguments}check_fields=CHECK, **_unknown):",
        "    _self._check_fields = check_fields",
        "    if _unknown: REJECT(_unknown)",
    ]
    setters = []
    for field in definition.fields:
        class_name = _class_name(field.type, namespace)
        default, assigned = _construction(field, class_name, namespace)
        constructor += [
            f"    if {field.name} is UNSET: _self._{field.name} = {default}",
            f"    else: _self.{field.name} = {assigned}",
        ]
        setters += [f"def set_{field.name}(self, value):", *_assignment(field, class_name)]
    exec(compile("\n".join(constructor + setters), f"<{definition.type_name}>", "exec"), namespace)
    return namespace


def _class_name(type_: d.AbstractType, namespace: dict[str, Any]) -> str:
    """What the generated source calls the class of single values; that of a nested message gets into the namespace."""
    element = d.element_type(type_)
    if not isinstance(element, d.NamespacedType):
        return d.python_type(element)
    name = element.type_name.replace("/", "__")
    namespace[name] = get_message(element.type_name)
    return name


def _construction(field: d.Member, class_name: str, namespace: dict[str, Any]) -> tuple[str, str]:
    """Source of the default value, and of the value to assign when one was given to the constructor."""
    name, type_, default = field.name, field.type, field.value
    match type_:
        case d.Array(d.BasicType(is_number=True) as element, size):
            import numpy as np

            namespace.update(NUMPY_ARRAY=np.array, ZEROS=np.zeros)
            code = element.traits.code
            values = f"ZEROS({size}, '{code}')" if default is None else f"NUMPY_ARRAY({default}, '{code}')"
            return values, f"NUMPY_ARRAY({name}, '{code}')"
        case d.AbstractSequence(value_type=d.BasicType(is_number=True) as element):
            code = element.traits.code
            # Converted before the check, so that integers do for floats: as in rosidl only when constructing.
            values = f"ARRAY('{code}', {default})" if default else f"ARRAY('{code}')"
            return values, f"{name} if HASATTR({name}, 'dtype') else ARRAY('{code}', {name})"
    single = _DEFAULTS.get(class_name) or f"{class_name}()"
    if default is not None:
        return repr(default), name
    if isinstance(type_, d.Array):
        return f"[{single} for _ in RANGE({type_.size})]", name
    return "[]" if isinstance(type_, d.AbstractSequence) else single, name


def _assignment(field: d.Member, class_name: str) -> list[str]:
    name, type_ = field.name, field.type
    match type_:
        case d.AbstractNestedType(d.BasicType(is_number=True) as element):
            convert = "PACKED_ARRAY" if isinstance(type_, d.Array) else "PACKED_SEQUENCE"
            arguments = f"value, '{name}', TYPES['{name}'], '{element.traits.code}', self._check_fields"
            return [f"    self._{name} = {convert}({arguments})"]
    lines = ["    if self._check_fields:"]
    for condition, words in checks(type_, class_name):
        text = f"The '{name}' field must be {words}"
        lines.append(f"        assert {condition}, {text!r}")
    return [*lines, f"    self._{name} = value"]
