"""Checks of values assigned to message fields, in rosidl's words, and conversion of numbers into packed containers."""

from __future__ import annotations

import math
import os
from array import array
from collections import UserList
from collections.abc import Callable, Sequence, Set
from typing import Any

from . import definition as d

CHECK_FIELDS: bool = __debug__ and os.environ.get("ROS_PYTHON_CHECK_FIELDS", "") != "0"
#: What may be assigned to several values, besides str, which is no sequence here.
SEQUENCES: Any = (Sequence, Set, UserList, memoryview, array)
#: rosidl's limits; that of float is a little below the largest float32.
_LARGEST = {"float": 3.402823466e38, "double": 1.7976931348623157e308}


def checks(type_: d.AbstractType, class_name: str) -> list[tuple[str, str]]:
    """Return conditions on a ``value`` as Python source, each with rosidl's words for what a field must be.

    `class_name` is that of single values.
    """
    match type_:
        case d.AbstractNestedType(element):
            # The inner ``value`` is one of the values.
            every = " and ".join(condition for condition, _ in checks(element, class_name))
            condition = f"isinstance(value, SEQUENCES) and not isinstance(value, str){_length(type_)}"
            return [(f"{condition} and all([{every} for value in value])", set_or_sequence(type_))]
        case d.NamespacedType():
            return [(f"isinstance(value, {class_name})", f"a sub message of type '{type_.name}'")]
        case d.AbstractGenericString(maximum_size=int(bound)):
            return [(f"isinstance(value, str) and len(value) <= {bound}", f"string value not longer than {bound}")]
        case d.BasicType("octet"):
            condition = "isinstance(value, (bytes, bytearray)) and len(value) == 1"
            return [(condition, "of type 'bytes' or 'ByteString' with length 1")]
    found = [(f"isinstance(value, {class_name})", f"of type '{class_name}'")]
    match type_:
        case d.BasicType("float"):
            limit = _LARGEST["float"]
            found.append((f"not abs(value) > {limit} or ISINF(value)", f"a float in [{-limit}, {limit}]"))
        case d.BasicType(typename) if typename in d.INTEGER_RANGES:
            low, high = d.INTEGER_RANGES[typename]
            found.append((f"{low} <= value <= {high}", f"an {_integer_range(typename)}"))
    return found


def _integer_range(typename: str) -> str:
    low, high = d.INTEGER_RANGES[typename]
    return f"{'integer' if low else 'unsigned integer'} in [{low}, {high}]"


def set_or_sequence(type_: d.AbstractNestedType) -> str:
    """Return rosidl's words for what an array or sequence must be."""
    element = type_.value_type
    text = "a set or sequence"
    match type_:
        case d.Array(size=size):
            text += f" with length {size}"
        case d.BoundedSequence(maximum_size=bound):
            text += f" with length <= {bound}"
    if isinstance(element, d.AbstractGenericString) and element.maximum_size is not None:
        text += f" and each string value not longer than {element.maximum_size}"
    python_type = element.name if isinstance(element, d.NamespacedType) else d.python_type(element)
    text += f" and each value of type '{python_type}'"
    match element:
        case d.BasicType("float" | "double" as typename):
            text += f" and each {typename} in [{-_LARGEST[typename]:f}, {_LARGEST[typename]:f}]"
        case d.BasicType(typename) if typename in d.INTEGER_RANGES:
            text += f" and each {_integer_range(typename)}"
    return text


def _length(type_: d.AbstractNestedType) -> str:
    match type_:
        case d.Array(size=size):
            return f" and len(value) == {size}"
        case d.BoundedSequence(maximum_size=bound):
            return f" and len(value) <= {bound}"
    return ""


def packed_sequence(value: Any, name: str, type_: d.AbstractSequence, code: str, check: bool) -> array[Any]:
    """Convert what was assigned to a sequence of numbers into an `array.array` of the type code.

    If `check` is set and it does not fit, AssertionError.
    """
    bound = getattr(type_, "maximum_size", math.inf)
    if value.__class__ is not array:
        fits = not check or (_are_numbers(value, code) and len(value) <= bound)
        packed: array[Any] = _converted(lambda: _to_array(value, code), fits, check, name, type_)
        return packed
    if check:
        assert value.typecode == code, f"The '{name}' array.array() must have the type code of '{code}'"
        assert len(value) <= bound, f"The '{name}' array.array() must have a size <= {bound}"
    return value if value.typecode == code else array(code, value)


def packed_array(value: Any, name: str, type_: d.Array, code: str, check: bool) -> Any:
    """Convert what was assigned to a fixed array of numbers into a numpy array; raises like `packed_sequence`."""
    import numpy as np

    if not isinstance(value, np.ndarray):
        fits = not check or (_are_numbers(value, code) and len(value) == type_.size)
        return _converted(lambda: np.array(list(value), code), fits, check, name, type_)
    if check:
        dtype = np.dtype(code)
        assert value.dtype == dtype, f"The '{name}' numpy.ndarray() must have the dtype of 'numpy.{dtype.name}'"
        assert value.shape == (type_.size,), f"The '{name}' numpy.ndarray() must have a size of {type_.size}"
    return value.astype(code, copy=False)


def _converted(convert: Callable[[], Any], fits: bool, check: bool, name: str, type_: d.AbstractNestedType) -> Any:
    try:
        if fits:
            return convert()
    except (OverflowError, TypeError, ValueError):
        if not check:
            raise
    raise AssertionError(f"The '{name}' field must be {set_or_sequence(type_)}")


def _to_array(value: Any, code: str) -> array[Any]:
    if hasattr(value, "dtype"):
        value = value.tobytes() if value.dtype == code and value.dtype.isnative else value.tolist()
    elif isinstance(value, bytes | bytearray) and code != "B":
        value = list(value)
    return array(code, value)


def _are_numbers(value: Any, code: str) -> bool:
    """Return whether numbers are of the right kind; ranges of integers show in the conversion."""
    if hasattr(value, "dtype"):
        return getattr(value, "ndim", 0) == 1 and value.dtype.kind in ("iufb" if code in "fd" else "iub")
    if not isinstance(value, SEQUENCES) or isinstance(value, str):
        return False
    if code in "fd" and not all([isinstance(item, float) for item in value]):
        return False
    return code != "f" or all(not abs(item) > _LARGEST["float"] or math.isinf(item) for item in value)
