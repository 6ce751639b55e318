"""Checks of values assigned to message fields, and conversion of several numbers into packed containers."""

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
#: rosidl's limit, a little below the largest float32.
_LARGEST_FLOAT32 = 3.402823466e38


def expected(type_: d.AbstractType) -> str:
    """Say what a field of the type holds, for error messages."""
    match type_:
        case d.Array(element, size):
            return f"{size} values, each {expected(element)}"
        case d.BoundedSequence(element, bound):
            return f"a sequence of at most {bound} values, each {expected(element)}"
        case d.AbstractNestedType(element):
            return f"a sequence, each value {expected(element)}"
        case d.NamespacedType():
            return f"a {type_.type_name}"
        case d.AbstractGenericString(maximum_size=int(bound)):
            return f"a str of at most {bound} characters"
        case d.BasicType("octet"):
            return "a bytes of length 1"
        case d.BasicType("float"):
            return f"a float in [{-_LARGEST_FLOAT32}, {_LARGEST_FLOAT32}]"
        case d.BasicType(typename) if typename in d.INTEGER_RANGES:
            return "an int in [{}, {}]".format(*d.INTEGER_RANGES[typename])
    return f"a {d.python_type(type_)}"


def condition(type_: d.AbstractType, class_name: str) -> str:
    """Return Python source that tells whether ``value`` fits a field; `class_name` is that of single values."""
    match type_:
        case d.AbstractNestedType(element):
            # The inner ``value`` is one of the values.
            every = f"all([{condition(element, class_name)} for value in value])"
            return f"isinstance(value, SEQUENCES) and not isinstance(value, str){_length(type_)} and {every}"
        case d.AbstractGenericString(maximum_size=int(bound)):
            return f"isinstance(value, str) and len(value) <= {bound}"
        case d.BasicType("octet"):
            return "isinstance(value, (bytes, bytearray)) and len(value) == 1"
        case d.BasicType("float"):
            return f"isinstance(value, float) and (not abs(value) > {_LARGEST_FLOAT32} or ISINF(value))"
        case d.BasicType(typename) if typename in d.INTEGER_RANGES:
            low, high = d.INTEGER_RANGES[typename]
            return f"isinstance(value, int) and {low} <= value <= {high}"
    return f"isinstance(value, {class_name})"


def _length(type_: d.AbstractNestedType) -> str:
    match type_:
        case d.Array(size=size):
            return f" and len(value) == {size}"
        case d.BoundedSequence(maximum_size=bound):
            return f" and len(value) <= {bound}"
    return ""


def packed_sequence(value: Any, type_: d.AbstractSequence, code: str, text: str, check: bool) -> array[Any]:
    """Convert what was assigned to a sequence of numbers into an `array.array` of the type code.

    If `check` is set and it does not fit, AssertionError with the text.
    """
    if value.__class__ is not array:
        value = _converted(value, code, text, check, lambda: _to_array(value, code))
    if check and (value.typecode != code or len(value) > getattr(type_, "maximum_size", math.inf)):
        raise AssertionError(text)
    return value if value.typecode == code else array(code, value)


def packed_array(value: Any, type_: d.Array, code: str, text: str, check: bool) -> Any:
    """Convert what was assigned to a fixed array of numbers into a numpy array; raises like `packed_sequence`."""
    import numpy as np

    if not isinstance(value, np.ndarray):
        value = _converted(value, code, text, check, lambda: np.array(list(value), code))
    if check and (value.dtype != code or value.shape != (type_.size,)):
        raise AssertionError(text)
    return value.astype(code, copy=False)


def _converted(value: Any, code: str, text: str, check: bool, convert: Callable[[], Any]) -> Any:
    if check and not _are_numbers(value, code):
        raise AssertionError(text)
    try:
        return convert()
    except (OverflowError, TypeError, ValueError):
        if check:
            raise AssertionError(text) from None
        raise


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
    return code != "f" or all(not abs(item) > _LARGEST_FLOAT32 or math.isinf(item) for item in value)
