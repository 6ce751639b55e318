"""Declares the parameters of a model on a node and keeps their values."""

from __future__ import annotations

import hashlib
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.parameter import Parameter

from fsw_control.parameters import (
    CONTENT_SHA256,
    ParameterModel,
    ParameterSpec,
    describe,
    validate,
)
from fsw_control.schema.errors import InputError

if TYPE_CHECKING:
    from rclpy.node import Node


class ParameterValues:
    """The last accepted parameters of a node; raises if a value given at start is invalid.

    ``values`` is replaced as a whole at each change, so readers may keep the dict.
    """

    def __init__(self, node: Node, model: ParameterModel) -> None:
        self._model, self._specs = model, describe(model)
        self._callbacks: list[Callable[[dict[str, Any]], None]] = []
        self._checks: list[Callable[[dict[str, Any]], str | None]] = []
        values = {name: _own_type(_declare(node, spec)) for name, spec in self._specs.items()}
        # checked together: a value given at start may contradict the default of another
        self.values = self._checked = validate(model, values)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._accept)

    def __getitem__(self, name: str) -> Any:
        return self.values[name]

    def on_change(self, callback: Callable[[dict[str, Any]], None]) -> None:
        """Call ``callback`` with all values after each accepted change."""
        self._callbacks.append(callback)

    def add_check(self, check: Callable[[dict[str, Any]], str | None]) -> None:
        """Add a check of all values before a change; it returns why not, or None to accept."""
        self._checks.append(check)

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        """Check all values after a change; parameters that are not declared here are ignored."""
        own = {new.name: _own_type(new.value) for new in parameters if new.name in self._specs}
        try:
            values = validate(self._model, self.values | own) if own else self.values
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        for check in self._checks:
            reason = check(values)
            if reason is not None:
                return SetParametersResult(successful=False, reason=reason)
        self._checked = values
        return SetParametersResult(successful=True)

    def _accept(self, _: list[Parameter]) -> None:
        """Take over the values of the last check; rclpy checks every change before it sets it."""
        if self._checked is not self.values:
            self.values = self._checked
            for callback in self._callbacks:
                callback(self.values)


def state_contents(node: Node, own: ParameterValues) -> None:
    """Declare beside each parameter ``..._file`` one with the hash of the file's content.

    So readers of the parameters, e.g. a recorder on another computer, can identify the content.
    """
    files = {f"{name}{CONTENT_SHA256}": name for name in own.values if name.endswith("_file")}

    def check(parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name in files and parameter.value != _sha256(own[files[parameter.name]]):
                reason = f"{parameter.name} follows from {files[parameter.name]}"
                return SetParametersResult(successful=False, reason=reason)
        return SetParametersResult(successful=True)

    def update(values: dict[str, Any]) -> None:
        hashes = {stated: _sha256(values[name]) for stated, name in files.items()}
        node.set_parameters([Parameter(name, value=value) for name, value in hashes.items()])

    node.add_on_set_parameters_callback(check)
    for stated, name in files.items():
        text = f"SHA-256 of the content of {name}, from which it follows; empty: no file"
        node.declare_parameter(stated, _sha256(own[name]), ParameterDescriptor(description=text))
    if files:
        own.on_change(update)


def _sha256(file: str) -> str:
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""
    except OSError:
        return "unreadable"


def _own_type(value: Any) -> Any:
    """A value of rclpy, which has arrays of numbers as ``array``."""
    return list(value) if isinstance(value, array | tuple) else value


def _ros_type(spec: ParameterSpec) -> Parameter.Type:
    return Parameter.Type["INTEGER" if spec.type == "int" else spec.type.upper()]


def _declare(node: Node, spec: ParameterSpec) -> Any:
    if spec.default == []:
        # rclpy infers a byte array from an empty list, so the type is declared first and the value
        # set afterwards. A parameter without value would empty the reply to a request for all of
        # them (ros2 param dump).
        kind, descriptor = _ros_type(spec), _descriptor(spec)
        descriptor.read_only = False
        value = node.declare_parameter(spec.name, kind, descriptor).value
        if value is None:
            node.set_parameters([Parameter(spec.name, kind, [])])
        if spec.read_only:
            node.set_descriptor(spec.name, _descriptor(spec))
        return value or []
    return node.declare_parameter(spec.name, spec.default, _descriptor(spec)).value


def _descriptor(spec: ParameterSpec) -> ParameterDescriptor:
    unit = f" [{spec.unit}]" if spec.unit else ""
    options = f" (one of {', '.join(spec.options)})" if spec.options else ""
    message = ParameterDescriptor(
        name=spec.name,
        type=_ros_type(spec).value,
        description=f"{spec.description}{unit}{options}",
        read_only=spec.read_only,
    )
    if spec.range is not None:
        low, high = spec.range
        if spec.type == "int":
            message.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
        elif spec.type == "double":
            bounds = FloatingPointRange(from_value=low, to_value=high, step=0.0)
            message.floating_point_range = [bounds]
    return message
