"""Generates CDR (XCDR1) encoders and decoders as Python source, one function per message type.

Nested messages are written in line, so that runs of fixed-size fields become one `struct.Struct` and most of the
alignment is known when the code is generated. A position is known as ``offset % modulus``; only where the modulus is
too small (after strings and sequences) the code aligns at runtime. Everything is little-endian.

Positions count from the start of the whole buffer with its 4 byte encapsulation header, and CDR aligns from the end of
that header. A prefix of 16 bytes (the header of ROS service calls) does not change any alignment.
"""

import struct
from array import array
from collections.abc import Callable
from typing import Any

import numpy as np

from . import catalogue
from . import definition as d
from .checks import CHECK_FIELDS
from .message import get_message

HEADER_SIZE = 4
_ZEROS = tuple(bytes(n) for n in range(9))


def minimum_size(type_: d.AbstractType) -> int:
    """Least number of bytes that a value takes, without alignment."""
    if isinstance(type_, d.BasicType):
        return type_.traits.size
    if isinstance(type_, d.Array):
        return type_.size * minimum_size(type_.value_type)
    if isinstance(type_, d.NamespacedType):
        return sum(minimum_size(field.type) for field in catalogue.structure(type_.type_name).fields) or 1
    return 4


class _Generator:
    """What encoder and decoder have in common: lines, names, the run of fixed-size fields, and the alignment."""

    #: What stands for the only byte of an empty structure, and for the position.
    filler: str
    position: str
    flush: Callable[[], None]
    skip: Callable[[str], str]
    nested: Callable[[d.NamespacedType, str], None]
    string: Callable[[d.AbstractGenericString, str], None]
    #: Makes a variable of several values ready: what they and their number are called.
    open: Callable[[d.AbstractNestedType, str], tuple[str, str]]
    block: Callable[[d.BasicType, str, str, bool], None]
    each: Callable[[d.AbstractType, str, str], None]

    def __init__(self) -> None:
        self.names: dict[str, Any] = {"Z": _ZEROS, "encode_wide": encode_wide, "decode_wide": decode_wide}
        self.names.update(new=object.__new__, array=array, frombuffer=np.frombuffer)
        self.lines: list[str] = []
        self.depth = 1
        self.modulus, self.offset = 8, 0
        self.format = ""
        self.run: list[str] = []
        self.count = 0

    def line(self, text: str) -> None:
        self.lines.append("    " * self.depth + text)

    def refuse(self, condition: str, text: str) -> None:
        self.line(f"if {condition}: raise ValueError({text!r})")

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

    def align(self, size: int) -> None:
        """Bring the position to a multiple of `size`, where need be by what is known when the code runs."""
        self.flush()
        if self.modulus < size:
            self.line(self.skip(self.padding(size)))
            self.known(size)
        elif padding := -self.offset % size:
            self.line(self.skip(str(padding)))
            self.advance(padding)

    def padding(self, size: int) -> str:
        return f"{HEADER_SIZE} - {self.position} & {size - 1}"

    def scalar(self, code: str, size: int, text: str) -> None:
        if size > self.modulus:
            self.align(size)
        padding = -self.offset % size
        self.format += "x" * padding + code
        self.run.append(text)
        self.advance(padding + size)

    def take_run(self) -> tuple[struct.Struct, str]:
        taken = struct.Struct("<" + self.format), ", ".join(self.run)
        self.format, self.run = "", []
        return taken

    def loop(self, head: str, body: Callable[[], None]) -> None:
        """Emit a loop whose body starts, each time, at the first of the alignments that its end preserves."""
        entries = [(modulus, self.offset % modulus) for modulus in (8, 4) if modulus <= self.modulus]
        self.line(head)
        self.depth += 1
        start = len(self.lines)
        for modulus, offset in (*entries, (1, 0)):
            del self.lines[start:]
            self.known(modulus, offset)
            body()
            self.flush()
            if self.modulus % modulus == 0 and self.offset % modulus == offset:
                break
        self.depth -= 1
        self.known(modulus, offset)

    def fields(self, type_: d.NamespacedType, target: str) -> None:
        fields = catalogue.structure(type_.type_name).fields
        for field in fields:
            self.value(field.type, f"{target}._{field.name}")
        if not fields:
            self.scalar("B", 1, self.filler)

    def value(self, type_: d.AbstractType, target: str) -> None:
        match type_:
            case d.BasicType():
                self.scalar(type_.traits.code, type_.traits.size, target)
            case d.NamespacedType():
                self.nested(type_, target)
            case d.AbstractGenericString():
                self.string(type_, target)
            case d.AbstractNestedType():
                self.several(type_, target)

    def several(self, type_: d.AbstractNestedType, target: str) -> None:
        element, is_array = type_.value_type, isinstance(type_, d.Array)
        values, count = self.open(type_, target)
        if not is_array:
            self.scalar("I", 4, count)
        self.flush()
        if isinstance(type_, d.BoundedSequence):
            self.refuse(f"{count} > {type_.maximum_size}", f"{_field(target)} is longer than its bound")
        if not isinstance(element, d.BasicType):
            self.each(element, values, count)
            return
        size = element.traits.size
        if is_array:
            self.align(size)
        elif size > 4 and (self.modulus < size or self.offset % size):
            self.line(f"if {count}: {self.skip(self.padding(size))}")
        self.block(element, values, count, is_array)
        if isinstance(type_, d.Array):
            self.advance(size * type_.size)
        else:
            self.known(min(size, 4))

    def compile(self, head: str, label: str) -> Any:
        exec(compile("\n".join((head, *self.lines)), f"<{label}>", "exec"), self.names)
        return self.names["run"]


def _field(target: str) -> str:
    return target.rpartition("._")[2]


class _Encoder(_Generator):
    """Source of ``run(m, w, t)``, which writes message `m` to a stream with `w`; `t` tells the position."""

    filler = "0"
    position = "t()"

    def write(self, text: str) -> None:
        self.line(f"w({text})")

    def flush(self) -> None:
        if self.run:
            packer, values = self.take_run()
            self.write(f"{self.constant('pack', packer.pack)}({values})")

    def skip(self, size: str) -> str:
        return f"w(Z[{size}])"

    def nested(self, type_: d.NamespacedType, target: str) -> None:
        local = self.name("m")
        self.line(f"{local} = {target}")
        self.fields(type_, local)

    def string(self, type_: d.AbstractGenericString, target: str) -> None:
        local, is_wide = self.name("s"), isinstance(type_, d.AbstractWString)
        # A narrow string is counted and written with its terminating zero.
        encoded = f"encode_wide({target})" if is_wide else f"({target} + '\\0').encode()"
        self.line(f"{local} = {encoded}")
        self.scalar("I", 4, f"len({local}) // 4" if is_wide else f"len({local})")
        self.flush()
        self.write(local)
        self.known(4 if is_wide else 1)

    def open(self, type_: d.AbstractNestedType, target: str) -> tuple[str, str]:
        local = self.name("a")
        self.line(f"{local} = {target}")
        if isinstance(type_, d.Array):
            self.refuse(f"len({local}) != {type_.size}", f"{_field(target)} must have {type_.size} values")
        return local, f"len({local})"

    def each(self, element: d.AbstractType, values: str, count: str) -> None:
        item = self.name("i")
        self.loop(f"for {item} in {values}:", lambda: self.value(element, item))

    def block(self, element: d.BasicType, values: str, count: str, is_array: bool) -> None:
        kinds = {"octet": f"b''.join({values})", "boolean": f"bytes(map(bool, {values}))"}
        self.write(kinds.get(element.typename, f"{values}.tobytes()" if is_array else values))


class _Decoder(_Generator):
    """Source of ``run(d, p)``, which reads a message from bytes `d` at position `p`: (message, position after it)."""

    filler = "_"
    position = "p"

    def flush(self) -> None:
        if self.run:
            packer, targets = self.take_run()
            self.line(f"{targets}, = {self.constant('unpack', packer.unpack_from)}(d, p)")
            self.line(f"p += {packer.size}")

    def skip(self, size: str) -> str:
        return f"p += {size}"

    def nested(self, type_: d.NamespacedType, target: str) -> None:
        local = self.name("m") if "." in target else target
        self.line(f"{local} = new({self.constant('C', get_message(type_.type_name))})")
        self.line(f"{local}._check_fields = {CHECK_FIELDS}")
        if local != target:
            self.line(f"{target} = {local}")
        self.fields(type_, local)

    def string(self, type_: d.AbstractGenericString, target: str) -> None:
        local = self.name("n")
        self.scalar("I", 4, local)
        self.flush()
        if isinstance(type_, d.AbstractWString):
            self.line(f"e = p + {local} * 4")
            self.refuse("e > len(d)", "string goes beyond the end")
            self.line(f"{target} = decode_wide(d[p:e])")
            self.known(4)
        else:
            # An empty string of length zero, without its terminator, is accepted as other readers do: then d[e - 1]
            # is the last byte of the length.
            self.line(f"e = p + {local}")
            self.refuse("d[e - 1]", "string is not terminated")
            self.line(f"{target} = d[p:e - 1].decode()")
            self.known(1)
        self.line("p = e")
        if type_.maximum_size is not None:
            self.refuse(f"len({target}) > {type_.maximum_size}", "string is longer than its bound")

    def open(self, type_: d.AbstractNestedType, target: str) -> tuple[str, str]:
        return target, str(type_.size) if isinstance(type_, d.Array) else self.name("n")

    def each(self, element: d.AbstractType, values: str, count: str) -> None:
        self.refuse(f"{count} * {minimum_size(element)} > len(d) - p", f"{_field(values)} goes beyond the end")
        local, item = self.name("a"), self.name("i")
        self.line(f"{values} = {local} = []")

        def read() -> None:
            self.value(element, item)
            self.flush()
            self.line(f"{local}.append({item})")

        self.loop(f"for _ in range({count}):", read)

    def block(self, element: d.BasicType, values: str, count: str, is_array: bool) -> None:
        code, size = element.traits[:2]
        self.line(f"e = p + {count} * {size}")
        if is_array and element.is_number:
            self.line(f"{values} = frombuffer(d, {code!r}, {count}, p).copy()")
            self.line("p = e")
            return
        self.refuse("e > len(d)", f"{_field(values)} goes beyond the end")
        if element.typename == "boolean":
            self.line(f"{values} = [b != 0 for b in d[p:e]]")
        elif element.typename == "octet":
            self.line(f"{values} = [d[i:i + 1] for i in range(p, e)]")
        else:
            local = self.name("a")
            self.line(f"{values} = {local} = array({code!r})")
            self.line(f"{local}.frombytes(memoryview(d)[p:e])")
        self.line("p = e")


def make_encoder(type_name: str) -> Callable[[Any, Callable[[Any], int], Callable[[], int]], None]:
    """Make the function that writes a message: ``encoder(message, write, tell)`` of a stream.

    The stream begins with the 4 byte header.
    """
    generator = _Encoder()
    generator.fields(d.namespaced(type_name), "m")
    generator.flush()
    run: Callable[..., None] = generator.compile("def run(m, w, t):", f"encode {type_name}")
    return run


def make_decoder(type_name: str) -> Callable[[bytes, int], tuple[Any, int]]:
    """Make the function that reads a message from a buffer: ``decoder(data, position) -> (message, end)``.

    The function raises ValueError (UnicodeDecodeError is one), IndexError or struct.error on malformed input; lengths
    are compared with what is left of the data before anything is allocated.
    """
    generator = _Decoder()
    generator.nested(d.namespaced(type_name), "m")
    generator.flush()
    generator.line("return m, p")
    decoder: Callable[[bytes, int], tuple[Any, int]] = generator.compile("def run(d, p):", f"decode {type_name}")
    return decoder


def encode_wide(text: str) -> bytes:
    """UTF-16 code units, each in 4 bytes, as rmw_cyclonedds writes a wstring."""
    return np.frombuffer(text.encode("utf-16-le"), "<u2").astype("<u4").tobytes()


def decode_wide(data: bytes) -> str:
    """Reverse of `encode_wide`; raises ValueError for what is not UTF-16."""
    units = np.frombuffer(data, "<u4")
    if (units > 0xFFFF).any():
        raise ValueError("wide string holds more than UTF-16")
    return units.astype("<u2").tobytes().decode("utf-16-le")
