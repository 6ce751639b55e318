"""The parameters of a node."""

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rcl_interfaces import msg
from rclpy import exceptions
from rclpy.names import validate_parameter_name
from rclpy.parameter import PARAMETER_SEPARATOR_STRING as SEPARATOR
from rclpy.parameter import Parameter, parameter_value_to_python

_WRONG_TYPE = "Wrong parameter type"
_Callback = Callable[[list[Parameter]], Any]


def _result(reason: str = "") -> Any:
    return msg.SetParametersResult(successful=not reason, reason=reason)


class ParameterStore:
    """Parameters with descriptors, overrides and callbacks: the parameter methods of a Node.

    Overrides replace the defaults given at declaration. `publish_event` takes a ParameterEvent with its parameters
    filled in, after every change. Nothing here needs the middleware.
    """

    #: Relative tolerance for bounds and steps of floating point ranges.
    PARAM_REL_TOL = 1e-6

    def __init__(
        self,
        overrides: Mapping[str, Parameter] | None = None,
        *,
        allow_undeclared: bool = False,
        publish_event: Callable[[Any], None] = lambda event: None,
    ) -> None:
        self._parameters: dict[str, Parameter] = {}
        self._descriptors: dict[str, Any] = {}
        self._parameter_overrides = dict(overrides or {})
        self._allow_undeclared_parameters = allow_undeclared
        self._publish_parameter_event = publish_event
        self._pre_set_parameters_callbacks: list[_Callback] = []
        self._on_set_parameters_callbacks: list[_Callback] = []
        self._post_set_parameters_callbacks: list[_Callback] = []

    def declare_parameter(
        self, name: str, value: Any = None, descriptor: Any = None, ignore_override: bool = False
    ) -> Parameter:
        """Declare one parameter; see `declare_parameters`.

        `value` is the default, a ``Parameter.Type`` for a parameter without default, or a ParameterValue.
        """
        without_default = value is None and descriptor is None
        entry = (name,) if without_default else (name, value, descriptor or msg.ParameterDescriptor())
        return self.declare_parameters("", [entry], ignore_override)[0]

    def declare_parameters(
        self, namespace: str, parameters: Sequence[tuple[Any, ...]], ignore_override: bool = False
    ) -> list[Parameter]:
        """Declare parameters given as (name,), (name, default or type) or (name, default or type, descriptor).

        Without ``dynamic_typing`` in the descriptor the type is fixed to that of the default. The on-set and post-set
        callbacks are called once for each parameter; if one is refused, those before it stay declared.
        """
        declared: list[Parameter] = []
        descriptors: dict[str, Any] = {}
        for index, entry in enumerate(parameters):
            name, value, descriptor = _declaration(namespace, index, entry)
            descriptors[name] = descriptor
            if name in self._parameter_overrides and not ignore_override:
                value = self._parameter_overrides[name].value
            declared.append(Parameter(name, value=value))
        already = [parameter.name for parameter in declared if parameter.name in self._parameters]
        if already:
            raise exceptions.ParameterAlreadyDeclaredException(already)
        for parameter in declared:
            result = self._set_atomically([parameter], descriptors)
            if not result.successful:
                if result.reason.startswith(_WRONG_TYPE):
                    expected = Parameter.Type(descriptors[parameter.name].type).name
                    raise exceptions.InvalidParameterTypeException(parameter, expected)
                raise exceptions.InvalidParameterValueException(parameter.name, parameter.value, result.reason)
        return [self._parameters[parameter.name] for parameter in declared]

    def undeclare_parameter(self, name: str) -> None:
        if not self.has_parameter(name):
            raise exceptions.ParameterNotDeclaredException(name)
        if self._descriptors[name].read_only:
            raise exceptions.ParameterImmutableException(name)
        del self._parameters[name]
        del self._descriptors[name]

    def has_parameter(self, name: str) -> bool:
        return name in self._parameters

    def _is_declared(self, name: str) -> bool:
        """Return whether a parameter is declared; raise if it is not and undeclared parameters are not allowed."""
        if name not in self._parameters and not self._allow_undeclared_parameters:
            raise exceptions.ParameterNotDeclaredException(name)
        return name in self._parameters

    def get_parameter_type(self, name: str) -> Any:
        """Return the type of a parameter as the number in ``ParameterType``, Type.NOT_SET for an undeclared one."""
        return self._parameters[name].type_.value if self._is_declared(name) else Parameter.Type.NOT_SET

    def get_parameter_types(self, names: list[str]) -> list[Any]:
        return [self.get_parameter_type(name) for name in _checked_names(names)]

    def get_parameter(self, name: str) -> Parameter:
        """Return a parameter; ParameterUninitializedException if it has a type and no value yet."""
        if not self._is_declared(name):
            return Parameter(name)
        parameter = self._parameters[name]
        if parameter.type_ is Parameter.Type.NOT_SET and not self._descriptors[name].dynamic_typing:
            raise exceptions.ParameterUninitializedException(name)
        return parameter

    def get_parameters(self, names: list[str]) -> list[Parameter]:
        return [self.get_parameter(name) for name in _checked_names(names)]

    def get_parameter_or(self, name: str, alternative_value: Parameter | None = None) -> Parameter:
        """Return a parameter, or the alternative (default: an unset Parameter) if it has no value."""
        parameter = self._parameters.get(name)
        if parameter is not None and parameter.type_ is not Parameter.Type.NOT_SET:
            return parameter
        return Parameter(name) if alternative_value is None else alternative_value

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Parameter]:
        """Return the parameters below a prefix by the rest of their names; an empty prefix means all."""
        prefix = prefix and prefix + SEPARATOR
        parameters = self._parameters.items()
        return {name[len(prefix) :]: parameter for name, parameter in parameters if name.startswith(prefix)}

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        """Return the names below any of the prefixes (none: all) down to a depth (0: any) and their own prefixes."""
        if not isinstance(prefixes, list):
            raise TypeError("The prefixes argument must be a list")
        if not all(isinstance(prefix, str) for prefix in prefixes):
            raise TypeError("All prefixes must be instances of type str")
        if not isinstance(depth, int):
            raise TypeError("The depth must be instance of type int")
        if depth < 0:
            raise ValueError("The depth must be greater than or equal to zero")

        def below(name: str, prefix: str | None) -> bool:
            start = "" if prefix is None else prefix + SEPARATOR
            is_shallow = depth == 0 or name[len(start) :].count(SEPARATOR) < depth
            return name == prefix or (name.startswith(start) and is_shallow)

        wanted: list[Any] = prefixes or [None]
        names = [name for name in self._parameters if any(below(name, prefix) for prefix in wanted)]
        parents = (name.rpartition(SEPARATOR)[0] for name in names)
        return msg.ListParametersResult(names=names, prefixes=list(dict.fromkeys(filter(None, parents))))

    def set_parameters(self, parameter_list: list[Parameter]) -> list[Any]:
        """Set parameters one after the other; an undeclared one raises, a refused one does not stop the others."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        """Set all the parameters or none.

        The pre-set callbacks may change the list, the on-set callbacks may refuse it, the post-set callbacks
        are called at the end. A dynamically typed parameter set to NOT_SET is undeclared.
        """
        if self._pre_set_parameters_callbacks:
            callbacks = list(self._pre_set_parameters_callbacks)
            parameter_list = [parameter for callback in callbacks for parameter in callback(parameter_list)]
            if not parameter_list:
                return _result(
                    "parameter list cannot be empty, this might be due to "
                    "pre_set_parameters_callback modifying the original parameters list."
                )
        if not all(isinstance(parameter, Parameter) for parameter in parameter_list):
            raise TypeError(f"parameter must be instance of type '{Parameter!r}'")
        undeclared = [parameter.name for parameter in parameter_list if parameter.name not in self._parameters]
        if undeclared and not self._allow_undeclared_parameters:
            raise exceptions.ParameterNotDeclaredException(undeclared)
        return self._set_atomically(parameter_list)

    def _set_atomically(self, parameter_list: list[Parameter], declared: Mapping[str, Any] | None = None) -> Any:
        """Check, set and announce; with the descriptors of a declaration read-only ones can be set, and stay unset."""
        for parameter in parameter_list:
            descriptor = (self._descriptors if declared is None else declared).get(parameter.name)
            if descriptor is None:
                continue
            if declared is None and descriptor.read_only:
                return _result(f"Trying to set a read-only parameter: {parameter.name}.")
            if reason := _apply_descriptor(parameter, descriptor, parameter.name in self._parameters):
                return _result(reason)
        for callback in list(self._on_set_parameters_callbacks):
            result = callback(parameter_list)
            if not result.successful:
                return result

        event = msg.ParameterEvent()
        for parameter in parameter_list:
            name, message = parameter.name, parameter.to_parameter_msg()
            if declared is not None:
                self._descriptors[name] = declared[name]
            elif parameter.type_ is Parameter.Type.NOT_SET:
                event.deleted_parameters.append(message)
                self._parameters.pop(name, None)
                self._descriptors.pop(name, None)
                continue
            elif name not in self._descriptors:
                self._descriptors[name] = msg.ParameterDescriptor(dynamic_typing=True)
            is_new = self.get_parameter_or(name).type_ is Parameter.Type.NOT_SET
            (event.new_parameters if is_new else event.changed_parameters).append(message)
            self._parameters[name] = parameter
        self._publish_parameter_event(event)
        for callback in list(self._post_set_parameters_callbacks):
            callback(parameter_list)
        return _result()

    def describe_parameter(self, name: str) -> Any:
        """Return the descriptor of a parameter, an empty one for an undeclared one."""
        return self._descriptors[name] if self._is_declared(name) else msg.ParameterDescriptor()

    def describe_parameters(self, names: list[str]) -> list[Any]:
        return [self.describe_parameter(name) for name in names]

    def set_descriptor(self, name: str, descriptor: Any, alternative_value: Any = None) -> Any:
        """Give a parameter a new descriptor and return its value: the present one or else the alternative."""
        if not self._is_declared(name):
            return Parameter(name).get_parameter_value()
        if self._descriptors[name].read_only:
            raise exceptions.ParameterImmutableException(name)
        parameter = self.get_parameter(name)
        reason = _apply_descriptor(parameter, descriptor, is_declared=True)
        if reason and alternative_value is not None:
            parameter = Parameter.from_parameter_msg(msg.Parameter(name=name, value=alternative_value))
            reason = _apply_descriptor(parameter, descriptor, is_declared=True)
        if reason:
            raise exceptions.InvalidParameterValueException(name, parameter.value, reason)
        self._parameters[name] = parameter
        self._descriptors[name] = descriptor
        return self.get_parameter(name).get_parameter_value()

    # The callback that was added last is called first.

    def add_pre_set_parameters_callback(self, callback: _Callback) -> None:
        """Call `callback` before parameters are checked; it returns the list to use."""
        self._pre_set_parameters_callbacks.insert(0, callback)

    def add_on_set_parameters_callback(self, callback: _Callback) -> None:
        """Call `callback` to accept or refuse parameters; it returns a SetParametersResult."""
        self._on_set_parameters_callbacks.insert(0, callback)

    def add_post_set_parameters_callback(self, callback: _Callback) -> None:
        self._post_set_parameters_callbacks.insert(0, callback)

    def remove_pre_set_parameters_callback(self, callback: _Callback) -> None:
        self._pre_set_parameters_callbacks.remove(callback)

    def remove_on_set_parameters_callback(self, callback: _Callback) -> None:
        self._on_set_parameters_callbacks.remove(callback)

    def remove_post_set_parameters_callback(self, callback: _Callback) -> None:
        self._post_set_parameters_callbacks.remove(callback)


def _declaration(namespace: str, index: int, entry: tuple[Any, ...]) -> tuple[str, Any, Any]:
    """Check one entry of `declare_parameters` and return full name, default and completed descriptor."""
    place = f"at index {index} in parameters list"
    if not 1 <= len(entry) <= 3:
        raise TypeError(f"Invalid parameter tuple length {place}: {entry}; expecting length between 1 and 3")
    name = entry[0]
    default = entry[1] if len(entry) > 1 else None
    descriptor = entry[2] if len(entry) > 2 else msg.ParameterDescriptor()
    if not isinstance(name, str):
        raise TypeError(f"First element {name} {place} is not a str.")
    if not isinstance(descriptor, msg.ParameterDescriptor):
        raise TypeError(f"Third element {descriptor} {place} is not a ParameterDescriptor.")
    name = f"{namespace}.{name}" if namespace else name
    validate_parameter_name(name)
    if len(entry) == 1:
        warnings.warn(
            f"when declaring parameter named '{name}', "
            "declaring a parameter only providing its name is deprecated. You have to either:\n"
            '\t- Pass a name and a default value different to "PARAMETER NOT SET" (and optionally a descriptor).\n'
            "\t- Pass a name and a parameter type.\n"
            "\t- Pass a name and a descriptor with `dynamic_typing=True",
            stacklevel=4,
        )
        descriptor.dynamic_typing = True
    if isinstance(default, Parameter.Type):
        if default is Parameter.Type.NOT_SET:
            raise ValueError(f"Cannot declare parameter {{{name}}} as statically typed of type NOT_SET")
        if descriptor.dynamic_typing:
            raise ValueError(
                f"When declaring parameter {{{name}}} passing a descriptor with"
                "`dynamic_typing=True` is not allowed when the parameter type is provided"
            )
        descriptor.type = default.value
        return name, None, descriptor
    if isinstance(default, msg.ParameterValue):
        default = parameter_value_to_python(default)
    if not descriptor.dynamic_typing:
        descriptor.type = Parameter.Type.from_parameter_value(default).value
        if default is None:
            raise ValueError("Cannot declare a statically typed parameter with default value of type PARAMETER_NOT_SET")
    return name, default, descriptor


def _checked_names(names: list[str]) -> list[str]:
    if not all(isinstance(name, str) for name in names):
        raise TypeError("All names must be instances of type str")
    return names


def _apply_descriptor(parameter: Parameter, descriptor: Any, is_declared: bool) -> str | None:
    """Complete the descriptor with name and type; return why the parameter does not comply with it."""
    descriptor.name = parameter.name
    if descriptor.dynamic_typing:
        descriptor.type = parameter.type_.value
    elif parameter.type_ is Parameter.Type.NOT_SET:
        if is_declared:
            return "Static parameter cannot be undeclared"
    elif parameter.type_.value != descriptor.type:
        expected = Parameter.Type(descriptor.type)
        return f"{_WRONG_TYPE}, expected '{expected}' got '{parameter.type_}'"
    return _range_error(parameter, descriptor)


def _range_error(parameter: Parameter, descriptor: Any) -> str | None:
    """Return why the value is outside the descriptor's range; None if it is inside or there is no range."""
    exact = parameter.type_ is Parameter.Type.INTEGER
    ranges: list[Any] = descriptor.integer_range if exact else descriptor.floating_point_range
    if not ranges or not (exact or parameter.type_ is Parameter.Type.DOUBLE):
        return None
    name, value, step = parameter.name, parameter.value, ranges[0].step
    low, high = sorted((ranges[0].from_value, ranges[0].to_value))

    def same(one: float, other: float) -> bool:
        return one == other if exact else math.isclose(one, other, rel_tol=ParameterStore.PARAM_REL_TOL)

    # Values on the edge are always allowed, whatever the step.
    if same(value, low) or same(value, high):
        return None
    if not low < value < high:
        return f"Parameter {name} out of range{'.' if exact else ''} Min: {low}, Max: {high}, value: {value}"
    if not step:
        return None
    steps = (value - low) // step if exact else round((value - low) / step)
    if same(value, low + steps * step):
        return None
    what = "a valid step" if exact else "close enough to a valid step"
    return f"The parameter value for {name} is not {what}. Min: {low}, max: {high}, value: {value}, step: {step}"
