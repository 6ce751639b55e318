"""Keeps XTypes information off the wire: rmw sends none, so that types match by name alone.

The cyclonedds package always announces the structure of its Python type, which here only carries CDR. So the size of
the topic's information is set to zero in memory while a reader or writer is made of the topic, and back afterwards.
Everything is checked first: where the memory does not look as expected (another version), nothing is touched.
"""

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from cyclonedds.internal import DDS

_WORD = ctypes.sizeof(ctypes.c_void_p)
#: the sertype's head (of the C library) is shorter than this many words
_SEARCHED_WORDS = 48


def _size_in_memory(topic: Any) -> ctypes.c_uint32 | None:
    """Return the size field of a topic's type information, None where it is not found for sure."""
    sample_type = topic.data_type
    information = sample_type.__idl__._xt_bytedata[0]
    get_sertype = getattr(DDS._dll_handle, "dds_get_entity_sertype", None)
    sertype = ctypes.c_void_p()
    if not information or get_sertype is None or get_sertype(topic._ref, ctypes.byref(sertype)) != 0:
        return None
    base = sertype.value or 0
    words = (ctypes.c_size_t * _SEARCHED_WORDS).from_address(base)
    for i in range(_SEARCHED_WORDS - 3):
        if words[i] == id(sample_type):
            # behind the Python type: flags, pointer to the information, its size
            size = ctypes.c_uint32.from_address(base + (i + 3) * _WORD)
            is_expected = size.value == len(information) and ctypes.string_at(words[i + 2], size.value) == information
            return size if is_expected else None
    return None


@contextmanager
def hidden(topic: Any) -> Iterator[Any]:
    """Readers and writers of the cyclonedds topic that are made in this context announce no type information.

    Not for two threads at once: no other thread may make that topic meanwhile.
    """
    size = _size_in_memory(topic)
    if size is None:
        yield topic
        return
    whole, size.value = size.value, 0
    try:
        yield topic
    finally:
        size.value = whole
