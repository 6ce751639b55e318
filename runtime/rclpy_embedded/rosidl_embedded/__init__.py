"""ROS 2 interfaces without generated code: message classes, CDR and type hashes from ``.msg`` and ``.srv`` files."""

from . import finder

finder.install()
