"""Checks of values assigned to message fields, with rosidl's assertion texts, and conversion into packed containers."""

from __future__ import annotations

import math
import os
from array import array
from collections import UserList
from collections.abc import Sequence, Set
from typing import Any, NoReturn

from .definition import (
    AbstractGenericString,
    AbstractNestedType,
    AbstractType,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)
from .parser import INTEGER_RANGES

CHECK_FIELDS: bool = __debug__ and os.environ.get("ROS_PYTHON_CHECK_FIELDS", "") != "0"

# rosidl's limits; the one of float is a little below the largest float32.
_BOUNDS = {"float": 3.402823466e38, "double": 1.7976931348623157e308}
_PYTHON_TYPES = {"boolean": "bool", "octet": "bytes", "float": "float", "double": "float"}
# What generated setters refer to by name.
NAMESPACE = {"Sequence": Sequence, "Set": Set, "UserList": UserList, "isinf": math.isinf}


def python_type(type_: AbstractType) -> str:
    """Name of the Python class of single values, as rosidl's messages of errors have it."""
    if isinstance(type_, NamespacedType):
        return type_.name
    if isinstance(type_, BasicType):
        return _PYTHON_TYPES.get(type_.typename, "int")
    return "str"


def check_source(name: str, type_: AbstractType, class_name: str) -> list[tuple[str, str]]:
    """Conditions on ``value`` as Python source, each with the text of the error if it is false.

    Parameters
    ----------
    name : str
        Field.
    type_ : AbstractType
        Its type; numeric arrays and sequences are for `packed_array` and `packed_sequence` instead.
    class_name : str
        What a nested message's class is called in the generated source.
    """
    label = f"The '{name}' field must be"
    if isinstance(type_, AbstractNestedType):
        return [_check_several(name, type_, class_name)]
    if isinstance(type_, NamespacedType):
        return [(f"isinstance(value, {class_name})", f"{label} a sub message of type '{type_.name}'")]
    if isinstance(type_, AbstractGenericString):
        if type_.has_maximum_size():
            bound = type_.maximum_size
            text = f"{label} string value not longer than {bound}"
            return [(f"isinstance(value, str) and len(value) <= {bound}", text)]
        return [("isinstance(value, str)", f"{label} of type 'str'")]
    assert isinstance(type_, BasicType)
    if type_.typename == "octet":
        text = f"{label} of type 'bytes' or 'ByteString' with length 1"
        return [("isinstance(value, (bytes, bytearray)) and len(value) == 1", text)]
    python = python_type(type_)
    checks = [(f"isinstance(value, {python})", f"{label} of type '{python}'")]
    if type_.typename in INTEGER_RANGES:
        low, high = INTEGER_RANGES[type_.typename]
        kind = "an integer" if low else "an unsigned integer"
        checks.append((f"{low} <= value <= {high}", f"{label} {kind} in [{low}, {high}]"))
    elif type_.typename == "float":
        limit = _BOUNDS["float"]
        condition = f"not abs(value) > {limit!r} or isinf(value)"
        checks.append((condition, f"{label} a float in [{-limit}, {limit}]"))
    return checks


def _check_several(name: str, type_: AbstractNestedType, class_name: str) -> tuple[str, str]:
    element = type_.value_type
    python = python_type(element)
    conditions = ["isinstance(value, (Sequence, Set, UserList)) and not isinstance(value, str)"]
    if isinstance(type_, Array):
        conditions.append(f"len(value) == {type_.size}")
    elif isinstance(type_, BoundedSequence):
        conditions.append(f"len(value) <= {type_.maximum_size}")
    class_name = class_name if isinstance(element, NamespacedType) else python
    conditions.append(f"all([isinstance(v, {class_name}) for v in value])")
    if isinstance(element, AbstractGenericString) and element.has_maximum_size():
        conditions.append(f"all([len(v) <= {element.maximum_size} for v in value])")
    if python == "bytes":
        conditions.append("all([len(v) == 1 for v in value])")
    return " and ".join(conditions), _text_of_several(name, type_)


def _text_of_several(name: str, type_: AbstractNestedType) -> str:
    element = type_.value_type
    text = f"The '{name}' field must be a set or sequence"
    if isinstance(type_, Array):
        text += f" with length {type_.size}"
    elif isinstance(type_, BoundedSequence):
        text += f" with length <= {type_.maximum_size}"
    if isinstance(element, AbstractGenericString) and element.has_maximum_size():
        text += f" and each string value not longer than {element.maximum_size}"
    text += f" and each value of type '{python_type(element)}'"
    typename = element.typename if isinstance(element, BasicType) else ""
    if typename in INTEGER_RANGES and typename != "octet":
        low, high = INTEGER_RANGES[typename]
        text += f" and each {'integer' if low else 'unsigned integer'} in [{low}, {high}]"
    elif typename in _BOUNDS:
        text += f" and each {typename} in [{-_BOUNDS[typename]:f}, {_BOUNDS[typename]:f}]"
    return text


def packed_sequence(value: Any, name: str, type_: AbstractNestedType, code: str, check: bool) -> array[Any]:
    """Convert what was assigned to a sequence of numbers into an `array.array`.

    Raises
    ------
    AssertionError
        If `check` is set and an element or the length does not fit.
    """
    bound = type_.maximum_size if isinstance(type_, BoundedSequence) else None
    if value.__class__ is array:
        if check:
            assert value.typecode == code, f"The '{name}' array.array() must have the type code of '{code}'"
            text = f"The '{name}' array.array() must have a size <= {bound}"
            assert bound is None or len(value) <= bound, text
        return value if value.typecode == code else array(code, value)
    if check and not _fits(value, type_):
        _refuse(name, type_)
    if hasattr(value, "dtype"):
        if value.dtype == code and value.dtype.isnative:
            packed = array(code)
            packed.frombytes(value.tobytes())
            return packed
        value = value.tolist()
    elif isinstance(value, bytes | bytearray | memoryview) and code != "B":
        value = list(value)
    try:
        return array(code, value)
    except (OverflowError, TypeError):
        if check:
            _refuse(name, type_)
        raise


def packed_array(value: Any, name: str, type_: Array, code: str, check: bool) -> Any:
    """Convert what was assigned to a fixed array of numbers into a numpy array; raises like `packed_sequence`."""
    import numpy as np

    dtype = np.dtype(code)
    if isinstance(value, np.ndarray):
        if check:
            text = f"The '{name}' numpy.ndarray() must have the dtype of 'numpy.{dtype.name}'"
            assert value.dtype == dtype, text
            assert value.shape == (type_.size,), f"The '{name}' numpy.ndarray() must have a size of {type_.size}"
        return value if value.dtype == dtype else value.astype(dtype)
    if check and not _fits(value, type_):
        _refuse(name, type_)
    try:
        return np.array(list(value), dtype=dtype)
    except (OverflowError, TypeError, ValueError):
        if check:
            _refuse(name, type_)
        raise


def _fits(value: Any, type_: AbstractNestedType) -> bool:
    """Tell whether length and type of the elements are right; ranges of integers show in the conversion."""
    if hasattr(value, "dtype"):
        if getattr(value, "ndim", 0) != 1 or value.dtype.kind not in "iufb":
            return False
    elif not isinstance(value, Sequence | Set | UserList | memoryview | array) or isinstance(value, str):
        return False
    if isinstance(type_, Array) and len(value) != type_.size:
        return False
    if isinstance(type_, BoundedSequence) and len(value) > type_.maximum_size:
        return False
    assert isinstance(type_.value_type, BasicType)
    typename = type_.value_type.typename
    if typename in INTEGER_RANGES:
        return getattr(getattr(value, "dtype", None), "kind", "i") != "f"
    if not hasattr(value, "dtype") and not all([isinstance(item, float) for item in value]):
        return False
    return typename == "double" or all(not abs(item) > _BOUNDS["float"] or math.isinf(item) for item in value)


def _refuse(name: str, type_: AbstractNestedType) -> NoReturn:
    raise AssertionError(_text_of_several(name, type_))
