"""Makes message and service classes that behave as those of rosidl's Python generator.

The source of a class is generated and compiled when the class is first asked for.

Fields are checked when they are assigned, with the assertions of rosidl. ``ROS_PYTHON_CHECK_FIELDS=0``, ``python -O``
or ``check_fields=False`` at construction turn this off.
"""

from __future__ import annotations

import copy
from array import array
from threading import RLock
from typing import Any, NoReturn, cast

from . import catalogue
from .checks import CHECK_FIELDS, NAMESPACE, check_source, packed_array, packed_sequence, python_type
from .definition import (
    CODES,
    PACKED,
    AbstractNestedType,
    AbstractSequence,
    AbstractType,
    AbstractWString,
    Array,
    BasicType,
    BoundedSequence,
    Field,
    InvalidInterfaceError,
    NamespacedType,
    Structure,
    element_type,
)

_lock = RLock()
_messages: dict[str, type] = {}
_services: dict[str, type] = {}
_pending: list[str] = []
_UNSET: Any = object()


def get_message(type_name: str) -> Any:
    """Class of a message, or of a service's request, response or event, by its name.

    Parameters
    ----------
    type_name : str
        ``std_msgs/msg/String``, ``std_msgs/String`` or ``std_srvs/srv/Trigger_Request``.

    Raises
    ------
    UnknownInterfaceError
        If there is no such interface.
    InvalidInterfaceError
        If its definition is wrong.
    """
    cls = _messages.get(type_name)
    if cls is not None:
        return cls
    full_name = "/".join(catalogue.split_name(type_name))
    with _lock:
        if full_name not in _messages:
            if full_name in _pending:
                raise InvalidInterfaceError(f"{full_name} contains itself: {' > '.join([*_pending, full_name])}")
            _pending.append(full_name)
            try:
                _messages[full_name] = _make_message(catalogue.structure(full_name))
            finally:
                _pending.pop()
        return _messages[full_name]


def get_service(type_name: str) -> Any:
    """Class of a service such as ``std_srvs/srv/Trigger``, with ``Request``, ``Response`` and ``Event``.

    Raises
    ------
    UnknownInterfaceError
        If there is no such service.
    InvalidInterfaceError
        If its definition is wrong.
    """
    cls = _services.get(type_name)
    if cls is not None:
        return cls
    catalogue.service(type_name)
    with _lock:
        if type_name not in _services:
            _services[type_name] = _make_service(type_name)
        return _services[type_name]


def field_type_text(type_: AbstractType) -> str:
    """Type as ``get_fields_and_field_types()`` shows it: ``double[3]``, ``sequence<std_msgs/Header>``."""
    element = element_type(type_)
    if isinstance(element, BasicType):
        text = element.typename
    elif isinstance(element, NamespacedType):
        text = f"{element.namespaces[0]}/{element.name}"
    else:
        bound = getattr(element, "maximum_size", None)
        text = ("wstring" if isinstance(element, AbstractWString) else "string") + (f"<{bound}>" if bound else "")
    if isinstance(type_, Array):
        return f"{text}[{type_.size}]"
    if isinstance(type_, BoundedSequence):
        return f"sequence<{text}, {type_.maximum_size}>"
    return f"sequence<{text}>" if isinstance(type_, AbstractSequence) else text


def _make_service(type_name: str) -> type:
    package, _, name = type_name.split("/")

    def refuse(self: object) -> NoReturn:
        raise NotImplementedError("Service classes can not be instantiated")

    # The event, which only service introspection uses, is made when it is asked for.
    event = property(lambda cls: get_message(f"{type_name}_Event"))
    metaclass = type(
        f"Metaclass_{name}", (type,), {"_TYPE_NAME": type_name, "__module__": f"{package}.srv", "Event": event}
    )
    members = {part: get_message(f"{type_name}_{part}") for part in ("Request", "Response")}
    return cast(type, metaclass(name, (), {"__module__": f"{package}.srv", "__init__": refuse, **members}))


def _make_message(definition: Structure) -> type:
    package, kind, name = definition.type_name.split("/")
    module = f"{package}.{kind}"
    values = {constant.name: constant.value for constant in definition.constants}
    values |= {f"{f.name.upper()}__DEFAULT": f.default for f in definition.fields if f.default is not None}
    # Read-only on the class by a property of its metaclass; a plain attribute for its instances.
    properties = {key: _read_only(value) for key, value in values.items()}
    metaclass = type(
        f"Metaclass_{name}", (type,), {**properties, "_TYPE_NAME": definition.type_name, "__module__": module}
    )
    # In capitals, because arguments of the constructor and members of the class have the names of fields.
    namespace: dict[str, Any] = {
        **NAMESPACE,
        "__name__": module,
        "Metaclass": metaclass,
        "UNSET": _UNSET,
        "CHECK": CHECK_FIELDS,
        "VALUES": values,
        "PROPERTY": property,
        "CLASSMETHOD": classmethod,
        "HASATTR": hasattr,
        "RANGE": range,
        "ARRAY": array,
        "PACKED_SEQUENCE": packed_sequence,
        "PACKED_ARRAY": packed_array,
        "REJECT": _reject,
        "TYPES": tuple(field.type for field in definition.fields),
        "REPR": _repr,
    }
    source = "\n".join(_class_source(definition, values, namespace))
    exec(compile(source, f"<{definition.type_name}>", "exec"), namespace)
    return cast(type, namespace[name])


def _read_only(value: Any) -> property:
    return property(lambda cls: copy.copy(value))


def _reject(unknown: dict[str, Any]) -> NoReturn:
    raise AssertionError(f"Invalid arguments passed to constructor: {', '.join(sorted(unknown))}")


def _repr(self: Any) -> str:
    cls = type(self)
    texts = []
    for name, text in cls._fields_and_field_types.items():
        value = getattr(self, name)
        shown = repr(value)
        if text.startswith("sequence<") and isinstance(value, array):
            shown = shown[len("array('d', ") : -1] if len(value) else "[]"
        texts.append(f"{name}={shown}")
    return f"{cls.__module__}.{cls.__name__}({', '.join(texts)})"


def _class_source(definition: Structure, values: dict[str, Any], namespace: dict[str, Any]) -> list[str]:
    name = definition.type_name.rpartition("/")[2]
    fields = definition.fields
    arguments = "".join(f"{field.name}=UNSET, " for field in fields)
    shown = {field.name: field_type_text(field.type) for field in fields}
    lines = [
        f"class {name}(metaclass=Metaclass):",
        f'    """Message class \'{name}\'."""',
        f"    __slots__ = {[*(f'_{field.name}' for field in fields), '_check_fields']}",
        f"    _fields_and_field_types = {shown}",
        "    SLOT_TYPES = TYPES",
        "    __repr__ = REPR",
        *(f"    {key} = VALUES['{key}']" for key in values),
        f"    def __init__(_self, *, {arguments}check_fields=CHECK, **_unknown):",
        "        _self._check_fields = check_fields",
        "        if _unknown: REJECT(_unknown)",
    ]
    for field in fields:
        default, given = _construction(field, namespace)
        lines += [
            f"        if {field.name} is UNSET: _self._{field.name} = {default}",
            f"        else: _self.{field.name} = {given}",
        ]
    same = [f"(self._{f.name} != other._{f.name})" + (".any()" if _packing(f.type) == "array" else "") for f in fields]
    lines += [
        "    def __eq__(self, other):",
        "        if not isinstance(other, self.__class__): return False",
        f"        return not ({' or '.join(same) or 'False'})",
        "    @CLASSMETHOD",
        "    def get_fields_and_field_types(cls):",
        "        return cls._fields_and_field_types.copy()",
    ]
    for index, field in enumerate(fields):
        lines += _property(field, index)
    return lines


def _packing(type_: AbstractType) -> str:
    """Container of several numbers: ``array`` (numpy), ``sequence`` (array.array), or neither."""
    element = element_type(type_)
    if element is type_ or not (isinstance(element, BasicType) and element.typename in PACKED):
        return ""
    return "array" if isinstance(type_, Array) else "sequence"


def _class_name(type_: AbstractType, namespace: dict[str, Any] | None = None) -> str:
    """How the generated source calls the class of a nested message, put into the namespace if one is given."""
    element = element_type(type_)
    if not isinstance(element, NamespacedType):
        return ""
    name = "__".join((*element.namespaces, element.name))
    if namespace is not None:
        namespace[name] = get_message(element.type_name)
    return name


def _construction(field: Field, namespace: dict[str, Any]) -> tuple[str, str]:
    """Source of the default value, and of the value to assign when one was given to the constructor."""
    name, type_ = field.name, field.type
    element = element_type(type_)
    packing = _packing(type_)
    class_name = _class_name(type_, namespace)
    if packing:
        assert isinstance(element, BasicType)
        code = CODES[element.typename][0]
        if packing == "sequence":
            default = f"ARRAY('{code}')" if field.default is None else f"ARRAY('{code}', {field.default})"
            # Converted before the check, so that integers do for floats: as in rosidl only when constructing.
            return default, f"{name} if HASATTR({name}, 'dtype') else ARRAY('{code}', {name})"
        import numpy as np

        namespace.update(NUMPY_ARRAY=np.array, ZEROS=np.zeros)
        assert isinstance(type_, Array)
        default = (
            f"ZEROS({type_.size}, '{code}')" if field.default is None else f"NUMPY_ARRAY({field.default}, '{code}')"
        )
        return default, f"NUMPY_ARRAY({name}, '{code}')"
    if field.default is not None:
        return repr(field.default), name
    if isinstance(type_, AbstractNestedType):
        if not isinstance(type_, Array):
            return "[]", name
        return f"[{_default(element, class_name)} for _ in RANGE({type_.size})]", name
    return _default(element, class_name), name


def _default(element: AbstractType, class_name: str) -> str:
    if class_name:
        return f"{class_name}()"
    python = python_type(element)
    return {"bool": "False", "bytes": repr(bytes(1)), "float": "0.0", "int": "0", "str": "''"}[python]


def _property(field: Field, index: int) -> list[str]:
    name, type_ = field.name, field.type
    lines = [
        "    @PROPERTY",
        f"    def {name}(self):",
        f'        """Message field \'{name}\'."""',
        f"        return self._{name}",
        f"    @{name}.setter",
        f"    def {name}(self, value):",
    ]
    packing = _packing(type_)
    if packing:
        element = element_type(type_)
        assert isinstance(element, BasicType)
        code = CODES[element.typename][0]
        arguments = f"value, '{name}', TYPES[{index}], '{code}', self._check_fields"
        return [*lines, f"        self._{name} = PACKED_{packing.upper()}({arguments})"]
    lines.append("        if self._check_fields:")
    for condition, text in check_source(name, type_, _class_name(type_)):
        lines.append(f"            assert {condition}, {text!r}")
    return [*lines, f"        self._{name} = value"]
