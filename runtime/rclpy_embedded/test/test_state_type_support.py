"""What has type support."""

import pytest
from rclpy.exceptions import NoTypeSupportImportedException
from rclpy.type_support import check_for_type_support
from std_msgs.msg import String
from std_srvs.srv import Trigger


class OfGenuineRclpy(type):
    @classmethod
    def __import_type_support__(cls) -> None:
        """What classes have that rosidl_generator_py has generated."""


def test_only_classes_of_this_runtime_have_type_support() -> None:
    for kind in (String, Trigger):
        check_for_type_support(kind)
    with pytest.raises(NoTypeSupportImportedException):
        check_for_type_support(OfGenuineRclpy("String", (), {}))
    with pytest.raises(AttributeError):
        check_for_type_support(object)
