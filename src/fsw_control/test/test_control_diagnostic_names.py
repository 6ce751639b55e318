"""Names of diagnostics in a domain that several welds share."""

import pytest

from fsw_control.diagnostic_names import local_name, qualified


@pytest.mark.parametrize(
    ("namespace", "name", "qualified_name"),
    [
        ("/", "fsw_plant", "fsw_plant"),
        ("/cell1", "fsw_plant", "cell1/fsw_plant"),
        ("/a/b", "fsw", "a/b/fsw"),
    ],
)
def test_a_name_carries_its_namespace(namespace, name, qualified_name):
    assert qualified(namespace, name) == qualified_name


@pytest.mark.parametrize("writer", ["/", "/cell1", "/cell2", "/cell1/inner"])
@pytest.mark.parametrize("reader", ["/", "/cell1", "/cell2", "/cell1/inner"])
def test_a_weld_sees_its_own_nodes_alone(writer, reader):
    name = f"{qualified(writer, 'fsw_plant')}: sensors"
    seen = local_name(name, qualified(writer, "fsw"), reader)
    assert seen == ("fsw_plant: sensors" if reader == writer else None)


@pytest.mark.parametrize(
    ("name", "at_root", "in_cell1"),
    [
        ("camera: lens", "camera: lens", "camera: lens"),
        ("I/O: card 3", "I/O: card 3", "I/O: card 3"),
        ("no part", "no part", "no part"),
        ("/cell1/camera: lens", "/cell1/camera: lens", "camera: lens"),
        ("/cell2/camera: lens", "/cell2/camera: lens", None),
        ("/camera: lens", "camera: lens", "/camera: lens"),
    ],
)
def test_other_nodes_are_hidden_only_if_they_name_another_namespace(name, at_root, in_cell1):
    for hardware_id in ("", "camera 7"):
        assert local_name(name, hardware_id, "/") == at_root
        assert local_name(name, hardware_id, "/cell1") == in_cell1
