"""The table of the sensors."""

import pytest

from fsw_control import messages_ros as convert
from fsw_control import parameters
from fsw_control.contract import Measurement
from fsw_control.sensors import OPTIONAL, REQUIRED, SENSORS
from fsw_schema.errors import InputError


def test_a_measurement_has_the_required_sensors_in_their_order():
    assert Measurement._fields[1 : 1 + len(REQUIRED)] == tuple(
        SENSORS[name].signal for name in REQUIRED
    )
    assert (*REQUIRED, *OPTIONAL) == tuple(SENSORS)


@pytest.mark.parametrize("name", SENSORS)
def test_a_row_fits_its_message_and_contains_no_contradiction(name):
    row = SENSORS[name]
    middle = 0.5 * (row.minimum + row.maximum)
    assert convert.sensor_value(name, convert.sensor_message(name, middle, 1)) == pytest.approx(
        middle
    )
    assert row.quantity.plausible.low <= row.minimum < row.maximum <= row.quantity.plausible.high
    assert (
        0.0 < row.noise <= row.quantity.noise.high
        and row.resolution <= row.quantity.resolution.high
    )
    assert (row.max_jump is None) <= (not row.required)


@pytest.mark.parametrize("field", ["topic", "signal"])
def test_names_are_unique(field):
    assert len({getattr(row, field) for row in SENSORS.values()}) == len(SENSORS)


def test_a_template_is_a_parameter_of_each_sensor():
    text = "$name.noise: {type: double, default_value: $noise, description: of the $title, range: $noise_range}"
    specs = parameters.parse(text)
    assert {spec.name: spec.default for spec in specs.values()} == {
        f"{name}.noise": row.noise for name, row in SENSORS.items()
    }
    assert "torque" in specs["torque.noise"].description
    assert specs["torque.noise"].range == (0.0, 500.0)


def test_a_group_of_templates_stays_together_and_unknown_fields_are_reported():
    entry = "{type: int, default_value: 1, description: d}"
    specs = parameters.parse(f"$name: {{a: {entry}, b: {entry}}}")
    assert list(specs)[:2] == ["depth.a", "depth.b"]
    with pytest.raises(InputError):
        parameters.parse(f"$nonsense.a: {entry}")
