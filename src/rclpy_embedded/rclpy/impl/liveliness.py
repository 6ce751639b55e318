"""The one call of Cyclone DDS that its Python API lacks."""

# No postponed annotations here: c_call reads them.

from cyclonedds.core import DDSException, Entity
from cyclonedds.internal import DDS, c_call, dds_c_t


class _Liveliness(DDS):
    @c_call("dds_assert_liveliness")
    def assert_(self, entity: dds_c_t.entity) -> dds_c_t.returnv:
        """Assert the liveliness of a writer or participant."""


def assert_liveliness(writer: Entity) -> None:
    """Say that a writer is alive."""
    code = _Liveliness(0).assert_(writer._ref)
    if code < 0:
        raise DDSException(code, "while asserting liveliness")
