"""Generates CDR (XCDR1) encoders and decoders as Python source, one function of each kind per message type.

Nested messages are written in line, so that runs of fixed-size fields become one `struct.Struct` and most of the
alignment is known when the code is generated. A position is known as ``offset % modulus``; only where the modulus is
too small (after strings and sequences) the code aligns at runtime. Everything is little-endian.

Positions count from the start of the whole buffer with its 4 byte encapsulation header, and CDR aligns from the end of
that header. A prefix of 16 bytes (the header of ROS service calls) does not change any alignment.
"""

import struct
from array import array
from typing import Any

import numpy as np

from . import catalogue
from . import definition as d
from .checks import CHECK_FIELDS
from .message import get_message

HEADER_SIZE = 4


class Codec:
    """Source of encoder and decoder of a message type, made in one walk, since both pass the same positions.

    ``encode(m, w, t)`` writes message `m` with `w` to a stream that begins with the 4 byte header; `t` tells the
    position. ``decode(d, p)`` reads a message from bytes `d` at position `p` and returns it with the position after it.
    It raises ValueError (UnicodeDecodeError is one), IndexError or struct.error on malformed input.
    Variables have the same names in both.
    """

    def __init__(self, type_name: str) -> None:
        self.type_name = type_name
        self.names: dict[str, Any] = {"Z": [bytes(n) for n in range(9)], "new": object.__new__, "array": array}
        self.names.update(frombuffer=np.frombuffer, encode_wide=encode_wide, decode_wide=decode_wide, _=0)
        self.encoder, self.decoder = ["def encode(m, w, t):"], ["def decode(d, p):"]
        self.depth = 1
        self.modulus, self.offset = 8, 0
        # Fixed-size values that one struct takes: its format and the variables.
        self.format = ""
        self.run: list[str] = []
        self.count = 0
        type_ = d.namespaced(type_name)
        self.create("m", type_)
        self.fields(type_, "m")
        self.flush()
        self.decode("return m, p")

    def compile(self, function: str) -> Any:
        """Return ``encode`` or ``decode``."""
        source = "\n".join(self.encoder if function == "encode" else self.decoder)
        exec(compile(source, f"<CDR of {self.type_name}>", "exec"), self.names)
        return self.names[function]

    def encode(self, *lines: str) -> None:
        self.encoder += ["    " * self.depth + line for line in lines]

    def decode(self, *lines: str) -> None:
        self.decoder += ["    " * self.depth + line for line in lines]

    def name(self, prefix: str) -> str:
        self.count += 1
        return f"{prefix}{self.count}"

    def constant(self, prefix: str, value: Any) -> str:
        name = self.name(prefix)
        self.names[name] = value
        return name

    def known(self, modulus: int, offset: int = 0) -> None:
        self.modulus, self.offset = modulus, offset

    def advance(self, size: int) -> None:
        self.offset = (self.offset + size) % self.modulus

    def skip_at_runtime(self, size: int, condition: str = "") -> None:
        """Bring the position to a multiple of `size` by what is known when the code runs."""
        self.encode(f"{condition}w(Z[{HEADER_SIZE} - t() & {size - 1}])")
        self.decode(f"{condition}p += {HEADER_SIZE} - p & {size - 1}")

    def align(self, size: int) -> None:
        self.flush()
        if self.modulus < size:
            self.skip_at_runtime(size)
            self.known(size)
        elif padding := -self.offset % size:
            self.encode(f"w(Z[{padding}])")
            self.decode(f"p += {padding}")
            self.advance(padding)

    def scalar(self, code: str, size: int, variable: str) -> None:
        if size > self.modulus:
            self.align(size)
        padding = -self.offset % size
        self.format += "x" * padding + code
        self.run.append(variable)
        self.advance(padding + size)

    def flush(self) -> None:
        """Pack and unpack the values of the run."""
        if self.run:
            packer, variables = struct.Struct("<" + self.format), ", ".join(self.run)
            self.encode(f"w({self.constant('pack', packer.pack)}({variables}))")
            self.decode(f"{variables}, = {self.constant('unpack', packer.unpack_from)}(d, p)", f"p += {packer.size}")
            self.format, self.run = "", []

    def fields(self, type_: d.NamespacedType, variable: str) -> None:
        fields = catalogue.structure(type_.type_name).fields
        for field in fields:
            self.value(field.type, f"{variable}._{field.name}")
        if not fields:  # one byte, always 0
            self.scalar("B", 1, "_")

    def value(self, type_: d.AbstractType, variable: str) -> None:
        match type_:
            case d.BasicType():
                self.scalar(type_.traits.code, type_.traits.size, variable)
            case d.NamespacedType():
                local = self.name("m")
                self.encode(f"{local} = {variable}")
                self.create(local, type_)
                self.decode(f"{variable} = {local}")
                self.fields(type_, local)
            case d.AbstractGenericString():
                self.string(type_, variable)
            case d.AbstractNestedType():
                self.several(type_, variable)

    def create(self, variable: str, type_: d.NamespacedType) -> None:
        self.decode(f"{variable} = new({self.constant('C', get_message(type_.type_name))})")
        self.decode(f"{variable}._check_fields = {CHECK_FIELDS}")

    def string(self, type_: d.AbstractGenericString, variable: str) -> None:
        local, count = self.name("s"), self.name("n")
        is_wide = isinstance(type_, d.AbstractWString)
        # A narrow string is counted and written with its terminating zero.
        self.encode(f"{local} = " + (f"encode_wide({variable})" if is_wide else f"({variable} + '\\0').encode()"))
        self.encode(f"{count} = len({local})" + (" // 4" if is_wide else ""))
        self.scalar("I", 4, count)
        self.flush()
        self.encode(f"w({local})")
        if is_wide:
            self.decode(f"e = p + {count} * 4", _refusal("e > len(d)", "string goes beyond the end"))
            self.decode(f"{variable} = decode_wide(d[p:e])")
        else:
            # An empty string of length zero, without its terminator, is accepted as other readers do: then d[e - 1]
            # is the last byte of the length.
            self.decode(f"e = p + {count}", _refusal("d[e - 1]", "string is not terminated"))
            self.decode(f"{variable} = d[p:e - 1].decode()")
        self.decode("p = e")
        self.known(4 if is_wide else 1)
        if type_.maximum_size is not None:
            self.decode(_refusal(f"len({variable}) > {type_.maximum_size}", "string is longer than its bound"))

    def several(self, type_: d.AbstractNestedType, variable: str) -> None:
        element, field = type_.value_type, variable.rpartition("._")[2]
        values, count = self.name("a"), self.name("n")
        self.encode(f"{values} = {variable}", f"{count} = len({values})")
        if isinstance(type_, d.Array):
            self.encode(_refusal(f"{count} != {type_.size}", f"{field} must have {type_.size} values"))
            self.decode(f"{count} = {type_.size}")
        else:
            self.scalar("I", 4, count)
        self.flush()
        if isinstance(type_, d.BoundedSequence):
            refusal = _refusal(f"{count} > {type_.maximum_size}", f"{field} is longer than its bound")
            self.encode(refusal)
            self.decode(refusal)
        if not isinstance(element, d.BasicType):
            # Each value takes a byte at least, so a count that goes beyond the data ends with them.
            self.decode(f"{variable} = {values} = []")
            self.each(element, values, count)
            return
        size = element.traits.size
        if isinstance(type_, d.Array):
            self.align(size)
        elif size > 4 and (self.modulus < size or self.offset % size):
            self.skip_at_runtime(size, f"if {count}: ")
        self.decode(f"e = p + {count} * {size}", _refusal("e > len(d)", f"{field} goes beyond the end"))
        self.block(element, values, count, isinstance(type_, d.Array))
        self.decode(f"{variable} = {values}")
        if isinstance(type_, d.Array):
            self.advance(size * type_.size)
        else:
            self.known(min(size, 4))

    def each(self, element: d.AbstractType, values: str, count: str) -> None:
        """Add a loop whose body starts, each time, at the first of the alignments that its end preserves."""
        item = self.name("i")
        entries = [(modulus, self.offset % modulus) for modulus in (8, 4) if modulus <= self.modulus]
        self.encode(f"for {item} in {values}:")
        self.decode(f"for _ in range({count}):")
        self.depth += 1
        starts = len(self.encoder), len(self.decoder)
        for modulus, offset in (*entries, (1, 0)):
            del self.encoder[starts[0] :], self.decoder[starts[1] :]
            self.known(modulus, offset)
            self.value(element, item)
            self.flush()
            if self.modulus % modulus == 0 and self.offset % modulus == offset:
                break
        self.decode(f"{values}.append({item})")
        self.depth -= 1
        self.known(modulus, offset)

    def block(self, element: d.BasicType, values: str, count: str, is_array: bool) -> None:
        code = element.traits.code
        if element.typename == "octet":
            self.encode(f"w(b''.join({values}))")
            self.decode(f"{values} = [d[i:i + 1] for i in range(p, e)]")
        elif element.typename == "boolean":
            self.encode(f"w(bytes(map(bool, {values})))")
            self.decode(f"{values} = [b != 0 for b in d[p:e]]")
        elif is_array:
            self.encode(f"w({values}.tobytes())")
            self.decode(f"{values} = frombuffer(d, {code!r}, {count}, p).copy()")
        else:
            self.encode(f"w({values})")
            self.decode(f"{values} = array({code!r})", f"{values}.frombytes(memoryview(d)[p:e])")
        self.decode("p = e")


def _refusal(condition: str, text: str) -> str:
    return f"if {condition}: raise ValueError({text!r})"


def encode_wide(text: str) -> bytes:
    """UTF-16 code units, each in 4 bytes, as rmw_cyclonedds writes a wstring."""
    return np.frombuffer(text.encode("utf-16-le"), "<u2").astype("<u4").tobytes()


def decode_wide(data: bytes) -> str:
    """Reverse of `encode_wide`; raises ValueError for what is not UTF-16."""
    units = np.frombuffer(data, "<u4")
    if (units > 0xFFFF).any():
        raise ValueError("wide string holds more than UTF-16")
    return units.astype("<u2").tobytes().decode("utf-16-le")
