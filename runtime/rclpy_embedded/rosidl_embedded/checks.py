"""Checks of values assigned to message fields, with rosidl's assertion texts, and conversion into packed containers."""

from __future__ import annotations

import math
import os
from array import array
from collections import UserList
from collections.abc import Sequence, Set
from typing import Any, NoReturn

from . import definition as d

CHECK_FIELDS: bool = __debug__ and os.environ.get("ROS_PYTHON_CHECK_FIELDS", "") != "0"

# rosidl's limits; the one of float is a little below the largest float32.
_LIMITS = {"float": 3.402823466e38, "double": 1.7976931348623157e308}
# What generated setters refer to by name.
NAMESPACE = {"Sequence": Sequence, "Set": Set, "UserList": UserList, "isinf": math.isinf}


def python_type(type_: d.AbstractType) -> str:
    """Name of the Python class of single values, as rosidl's messages of errors have it."""
    if isinstance(type_, d.NamespacedType):
        return type_.name
    return type_.traits.python if isinstance(type_, d.BasicType) else "str"


def check_source(name: str, type_: d.AbstractType, class_name: str) -> list[tuple[str, str]]:
    """Conditions on ``value`` as Python source, each with the text of the error if it is false.

    The source calls the class of single values `class_name`. Several numbers are for `packed_array` and
    `packed_sequence` instead.
    """
    label = f"The '{name}' field must be"
    match type_:
        case d.AbstractNestedType():
            return [_check_several(name, type_, class_name)]
        case d.NamespacedType():
            return [(f"isinstance(value, {class_name})", f"{label} a sub message of type '{type_.name}'")]
        case d.AbstractGenericString(maximum_size=int(bound)):
            condition = f"isinstance(value, str) and len(value) <= {bound}"
            return [(condition, f"{label} string value not longer than {bound}")]
        case d.BasicType("octet"):
            condition = "isinstance(value, (bytes, bytearray)) and len(value) == 1"
            return [(condition, f"{label} of type 'bytes' or 'ByteString' with length 1")]
    checks = [(f"isinstance(value, {class_name})", f"{label} of type '{class_name}'")]
    match type_:
        case d.BasicType("float"):
            limit = _LIMITS["float"]
            checks.append((f"not abs(value) > {limit} or isinf(value)", f"{label} a float in [{-limit}, {limit}]"))
        case d.BasicType(typename) if typename in d.INTEGER_RANGES:
            low, high = d.INTEGER_RANGES[typename]
            kind = "an integer" if low else "an unsigned integer"
            checks.append((f"{low} <= value <= {high}", f"{label} {kind} in [{low}, {high}]"))
    return checks


def _check_several(name: str, type_: d.AbstractNestedType, class_name: str) -> tuple[str, str]:
    """Condition on an array or sequence and the text of the error, which for numbers names their range too."""
    element, python = type_.value_type, python_type(type_.value_type)
    conditions = ["isinstance(value, (Sequence, Set, UserList)) and not isinstance(value, str)"]
    text = f"The '{name}' field must be a set or sequence"
    match type_:
        case d.Array(size=size):
            conditions.append(f"len(value) == {size}")
            text += f" with length {size}"
        case d.BoundedSequence(maximum_size=bound):
            conditions.append(f"len(value) <= {bound}")
            text += f" with length <= {bound}"
    conditions.append(f"all([isinstance(v, {class_name}) for v in value])")
    each = f" and each value of type '{python}'"
    match element:
        case d.AbstractGenericString(maximum_size=int(bound)):
            conditions.append(f"all([len(v) <= {bound} for v in value])")
            each = f" and each string value not longer than {bound}" + each
        case d.BasicType("octet"):
            conditions.append("all([len(v) == 1 for v in value])")
        case d.BasicType("float" | "double" as typename):
            each += f" and each {typename} in [{-_LIMITS[typename]:f}, {_LIMITS[typename]:f}]"
        case d.BasicType(typename) if typename in d.INTEGER_RANGES:
            low, high = d.INTEGER_RANGES[typename]
            each += f" and each {'integer' if low else 'unsigned integer'} in [{low}, {high}]"
    return " and ".join(conditions), text + each


def packed_sequence(value: Any, name: str, type_: d.AbstractNestedType, code: str, check: bool) -> array[Any]:
    """Convert what was assigned to a sequence of numbers into an `array.array`.

    AssertionError if `check` is set and an element or the length does not fit.
    """
    if value.__class__ is array:
        if check:
            assert value.typecode == code, f"The '{name}' array.array() must have the type code of '{code}'"
            if isinstance(type_, d.BoundedSequence):
                text = f"The '{name}' array.array() must have a size <= {type_.maximum_size}"
                assert len(value) <= type_.maximum_size, text
        return value if value.typecode == code else array(code, value)
    if check and not _fits(value, type_, code):
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


def packed_array(value: Any, name: str, type_: d.Array, code: str, check: bool) -> Any:
    """Convert what was assigned to a fixed array of numbers into a numpy array; raises like `packed_sequence`."""
    import numpy as np

    dtype = np.dtype(code)
    if isinstance(value, np.ndarray):
        if check:
            assert value.dtype == dtype, f"The '{name}' numpy.ndarray() must have the dtype of 'numpy.{dtype.name}'"
            assert value.shape == (type_.size,), f"The '{name}' numpy.ndarray() must have a size of {type_.size}"
        return value if value.dtype == dtype else value.astype(dtype)
    if check and not _fits(value, type_, code):
        _refuse(name, type_)
    try:
        return np.array(list(value), dtype=dtype)
    except (OverflowError, TypeError, ValueError):
        if check:
            _refuse(name, type_)
        raise


def _fits(value: Any, type_: d.AbstractNestedType, code: str) -> bool:
    """Tell whether length and type of the elements are right; ranges of integers show in the conversion."""
    if hasattr(value, "dtype"):
        fits = getattr(value, "ndim", 0) == 1 and value.dtype.kind in ("iufb" if code in "fd" else "iub")
    else:
        fits = isinstance(value, Sequence | Set | UserList | memoryview | array) and not isinstance(value, str)
        fits = fits and (code not in "fd" or all([isinstance(item, float) for item in value]))
    if not fits or (isinstance(type_, d.Array) and len(value) != type_.size):
        return False
    if isinstance(type_, d.BoundedSequence) and len(value) > type_.maximum_size:
        return False
    return code != "f" or all(not abs(item) > _LIMITS["float"] or math.isinf(item) for item in value)


def _refuse(name: str, type_: d.AbstractNestedType) -> NoReturn:
    raise AssertionError(_check_several(name, type_, "")[1])
