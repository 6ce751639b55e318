"""The controllers as C sources: libraries, sizes, tables and signals."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from fsw_control.c_library import CLibrary
from fsw_decentral import DecentralController
from fsw_decentral.controller import KERNEL as DECENTRAL
from fsw_export.choice import render
from fsw_export.signals import (
    DECENTRAL_INPUTS,
    DECENTRAL_OUTPUTS,
    NMPC_INPUTS,
    NMPC_OUTPUTS,
    Signal,
)
from fsw_nmpc import NmpcController
from fsw_nmpc.library import KERNEL as NMPC
from fsw_nmpc.library import Tables, tuning_of


@dataclass(frozen=True)
class ControllerSources:
    """All parts of a controller in an exported folder or FMU."""

    name: str  #: ``nmpc`` or ``decentral``
    title: str
    library: CLibrary
    sizes: Mapping[str, int]  #: macros that lower the header's sizes to those of the model
    arrays: Mapping[str, Any]  #: tables that the structs' pointers of the same name refer to
    structs: Mapping[
        str, Any
    ]  #: arguments of the controller's initialisation, by kind: ``model``, ``tuning``
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]

    @property
    def prefix(self) -> str:
        """Prefix of all functions, structs and files."""
        return self.library.package

    @property
    def exported(self) -> list[str]:
        """Arguments of ``<prefix>_init`` after the controller."""
        return [f"&{self.prefix}_exported_{kind}" for kind in self.structs]

    @cached_property
    def _tables(self) -> str:
        structs = {kind: self._members(struct[0]) for kind, struct in self.structs.items()}
        arrays = {name: array.ravel().tolist() for name, array in self.arrays.items()}
        return render("tables.c", prefix=self.prefix, arrays=arrays, structs=structs)

    def _members(self, struct: Any) -> dict[str, Any]:
        """Values of a struct's members; a pointer is the name of its array."""
        values = {}
        for field, member in self.library.ffi.typeof(struct).fields:
            kind, value = member.type.kind, getattr(struct, field)
            values[field] = (
                field if kind == "pointer" else self._members(value) if kind == "struct" else value
            )
        return values

    @cached_property
    def digest(self) -> str:
        """Digest of sources, model and tuning; ``<prefix>_id()`` returns it."""
        return hashlib.sha256(f"{self.library.source_id()}\0{self._tables}".encode()).hexdigest()[
            :16
        ]

    def files(self) -> dict[str, str]:
        """Text of every source file by name, tables included."""
        texts = {
            p.name: p.read_text(encoding="utf-8")
            for p in sorted(self.library.folder.glob("*.[ch]"))
        }
        header = texts[f"{self.prefix}.h"]
        for size, value in self.sizes.items():
            header = re.sub(
                rf"#ifndef {size}\n(#define {size} )\d+(.*\n)#endif\n", rf"\g<1>{value}\2", header
            )
        guard = f"#define {self.prefix.upper()}_H\n"
        identity = (
            f'#define {self.prefix.upper()}_ID "{self.digest}" /* of sources, '
            "model and tuning */\n"
        )
        texts[f"{self.prefix}.h"] = header.replace(guard, f"{guard}{identity}", 1)
        texts[f"{self.prefix}_tables.h"] = render(
            "tables.h", prefix=self.prefix, structs=self.structs
        )
        texts[f"{self.prefix}_tables.c"] = self._tables
        return texts


def sources_of(controller: NmpcController | DecentralController) -> ControllerSources:
    """Sources of a controller with its model and tuning."""
    if isinstance(controller, DecentralController):
        return ControllerSources(
            name="decentral",
            title="decentralized control of depth and temperature",
            library=DECENTRAL,
            sizes={},
            arrays={},
            structs={"tuning": DECENTRAL.ffi.addressof(controller.library.state, "tuning")},
            inputs=DECENTRAL_INPUTS,
            outputs=DECENTRAL_OUTPUTS,
        )
    tables = Tables(controller.settings.model, controller.library.horizon)
    return ControllerSources(
        name="nmpc",
        title="nonlinear model predictive control of depth and temperature",
        library=NMPC,
        sizes={
            "FSW_MAX_BLOCKS": tables.model.n_blocks,
            "FSW_MAX_STEPS": tables.model.n_steps,
            "FSW_MAX_OUT": tables.model.n_out,
            "FSW_MAX_HISTORY": tables.model.n_history,
        },
        arrays=tables.arrays,
        structs={"model": tables.model, "tuning": tuning_of(controller.settings)},
        inputs=NMPC_INPUTS,
        outputs=NMPC_OUTPUTS,
    )
