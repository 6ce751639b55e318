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


def python_type(type_: d.AbstractType) -> str:
    """Name of the Python class of single values, as rosidl's messages of errors have it."""
    if isinstance(type_, d.NamespacedType):
        return type_.name
    return type_.traits.python if isinstance(type_, d.BasicType) else "str"


def check_source(name: str, type_: d.AbstractType, class_name: str) -> list[tuple[str, str]]:
    """Conditions on a single ``value`` as Python source, each with the text of the error if it is false.

    The source calls the class of the value `class_name`.
    """
    label = f"The '{name}' field must be"
    match type_:
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
            checks.append((f"not abs(value) > {limit} or ISINF(value)", f"{label} a float in [{-limit}, {limit}]"))
        case d.BasicType(typename) if typename in d.INTEGER_RANGES:
            low, high = d.INTEGER_RANGES[typename]
            checks.append((f"{low} <= value <= {high}", f"{label} an {_integer_range(typename)}"))
    return checks


def _integer_range(typename: str) -> str:
    low, high = d.INTEGER_RANGES[typename]
    return f"{'integer' if low else 'unsigned integer'} in [{low}, {high}]"


def _refuse(name: str, type_: d.AbstractNestedType) -> NoReturn:
    """Raise the error about an array or sequence."""
    text = f"The '{name}' field must be a set or sequence"
    match type_:
        case d.Array(size=size):
            text += f" with length {size}"
        case d.BoundedSequence(maximum_size=bound):
            text += f" with length <= {bound}"
    each = f" and each value of type '{python_type(type_.value_type)}'"
    match type_.value_type:
        case d.AbstractGenericString(maximum_size=int(bound)):
            each = f" and each string value not longer than {bound}" + each
        case d.BasicType("float" | "double" as typename):
            each += f" and each {typename} in [{-_LIMITS[typename]:f}, {_LIMITS[typename]:f}]"
        case d.BasicType(typename) if typename in d.INTEGER_RANGES:
            each += f" and each {_integer_range(typename)}"
    raise AssertionError(text + each)


def _has_length(value: Any, type_: d.AbstractNestedType) -> bool:
    if isinstance(type_, d.Array):
        return len(value) == type_.size
    return not isinstance(type_, d.BoundedSequence) or len(value) <= type_.maximum_size


def checked_list(value: Any, name: str, type_: d.AbstractNestedType, item_class: type, check: bool) -> Any:
    """Return what was assigned to several values other than numbers; raises like `packed_sequence`."""
    if check:
        fits = isinstance(value, Sequence | Set | UserList) and not isinstance(value, str) and _has_length(value, type_)
        if not fits or not all([isinstance(item, item_class) for item in value]):
            _refuse(name, type_)
        match type_.value_type:
            case d.AbstractGenericString(maximum_size=int(bound)) if any([len(item) > bound for item in value]):
                _refuse(name, type_)
            case d.BasicType("octet") if any([len(item) != 1 for item in value]):
                _refuse(name, type_)
    return value


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
    """Tell whether length and type of numbers are right; ranges of integers show in the conversion."""
    if hasattr(value, "dtype"):
        fits = getattr(value, "ndim", 0) == 1 and value.dtype.kind in ("iufb" if code in "fd" else "iub")
    else:
        fits = isinstance(value, Sequence | Set | UserList | memoryview | array) and not isinstance(value, str)
        fits = fits and (code not in "fd" or all([isinstance(item, float) for item in value]))
    if not fits or not _has_length(value, type_):
        return False
    return code != "f" or all(not abs(item) > _LIMITS["float"] or math.isinf(item) for item in value)
