"""The controllers as C libraries: their sources, sizes, tables and signals."""

from __future__ import annotations

import ctypes
import hashlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fsw_decentral import kernel_build as decentral_build
from fsw_decentral.library import Library as DecentralLibrary
from fsw_export import c_text
from fsw_export.signals import DECENTRAL_INPUTS, DECENTRAL_OUTPUTS, NMPC_INPUTS, NMPC_OUTPUTS, Signal
from fsw_nmpc import kernel_build
from fsw_nmpc.library import Library, Tables
from fsw_nmpc.settings import Settings


@dataclass(frozen=True, slots=True)
class ControllerSources:
    """All of a controller that an exported folder or FMU is made of.

    Attributes
    ----------
    name : str
        ``nmpc`` or ``decentral``.
    title : str
    folder : Path
        Of the C sources.
    header : str
        Name of the interface's header.
    prefix : str
        Of the library's functions: ``<prefix>_init`` and so on; also the type of the state.
    sizes : dict of str to int
        Macros that lower the header's sizes to those of the model.
    tables : str
        C text: definitions of the constants.
    declarations : str
        C text: their declarations.
    start : str
        Arguments of ``<prefix>_init`` after the controller.
    input_type, output_type : str
        Structs of a tick.
    inputs, outputs : tuple of Signal
    """

    name: str
    title: str
    folder: Path
    header: str
    prefix: str
    sizes: dict[str, int]
    tables: str
    declarations: str
    start: str
    input_type: str
    output_type: str
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]

    @property
    def tables_name(self) -> str:
        """Name, without ending, of the files with model and tuning."""
        return f"fsw_{self.name}_tables"

    def digest(self) -> str:
        """Digest of sources, model and tuning; ``<prefix>_id()`` returns it."""
        sources = [path.read_text(encoding="utf-8") for path in sorted(self.folder.glob("*.[ch]"))]
        return hashlib.sha256("\0".join([*sources, self.tables]).encode()).hexdigest()[:16]

    def files(self) -> dict[str, str]:
        """Text of every source file by name, tables included."""
        texts = {p.name: p.read_text(encoding="utf-8") for p in sorted(self.folder.glob("*.[ch]"))}
        header = texts[self.header]
        for size, value in self.sizes.items():
            header = re.sub(rf"#ifndef {size}\n(#define {size} )\d+(.*\n)#endif\n", rf"\g<1>{value}\2", header)
        guard = f"#define {Path(self.header).stem.upper()}_H\n"
        identity = f'#define {self.prefix.upper()}_ID "{self.digest()}" /* of sources, model and tuning */\n'
        texts[self.header] = header.replace(guard, f"{guard}{identity}", 1)
        name = self.tables_name
        texts[f"{name}.h"] = (
            f"/* Model and tuning, written by fsw.py export. */\n#ifndef {name.upper()}_H\n#define {name.upper()}_H\n\n"
            f'#include "{self.header}"\n\n#ifdef __cplusplus\nextern "C" {{\n#endif\n{self.declarations}'
            "#ifdef __cplusplus\n}\n#endif\n#endif\n"
        )
        texts[f"{name}.c"] = f'/* Written by fsw.py export; do not edit. */\n#include "{name}.h"\n\n{self.tables}'
        return texts


def nmpc_sources(library: Library, settings: Settings) -> ControllerSources:
    """Sources of the NMPC with the model and tuning of a controller."""
    tables, horizon = Tables(settings.model, library.horizon), library.horizon
    model = tables.model
    lengths = {
        "step_interval": model.n_steps,
        "interval_block": model.n_out,
        "interval_ticks": model.n_out,
        "block_reach": model.n_blocks,
        "out_step": model.n_out,
        "depth_width": model.n_out,
        "temp_width": model.n_out,
        "time_s": model.n_out,
        "modes": len(np.ravel(horizon.modes)),
        "weight_start": model.n_steps + 1,
        "weight_segment": model.n_weights,
        "weight": len(np.ravel(horizon.weight)),
        "ahead_power": 6 * model.n_history,
        "torque_par": 6,
    }
    parts = []
    for name, length in lengths.items():
        pointer: Any = getattr(model, name)
        kind = "int" if pointer._type_ is ctypes.c_int else "double"
        parts.append(c_text.array(kind, name, pointer[:length]))
    parts.append(c_text.struct("fsw_model", "fsw_nmpc_model", model, {name: name for name in lengths}))
    parts.append(c_text.struct("fsw_tuning", "fsw_nmpc_tuning", settings.struct()))
    return ControllerSources(
        name="nmpc",
        title="nonlinear model predictive control of depth and temperature",
        folder=kernel_build.FOLDER,
        header="fsw_controller.h",
        prefix="fsw_controller",
        sizes={
            "FSW_MAX_BLOCKS": model.n_blocks,
            "FSW_MAX_STEPS": model.n_steps,
            "FSW_MAX_OUT": model.n_out,
            "FSW_MAX_HISTORY": model.n_history,
        },
        tables="\n".join(parts),
        declarations="extern const fsw_model fsw_nmpc_model;\nextern const fsw_tuning fsw_nmpc_tuning;\n",
        start="&fsw_nmpc_model, &fsw_nmpc_tuning",
        input_type="fsw_input",
        output_type="fsw_output",
        inputs=NMPC_INPUTS,
        outputs=NMPC_OUTPUTS,
    )


def decentral_sources(library: DecentralLibrary) -> ControllerSources:
    """Sources of the decentralized controller with the tuning of a controller."""
    return ControllerSources(
        name="decentral",
        title="decentralized control of depth and temperature",
        folder=decentral_build.LIBRARY.folder,
        header="fsw_decentral.h",
        prefix="fsw_decentral",
        sizes={},
        tables=c_text.struct("fsw_decentral_tuning", "fsw_decentral_gains", library.state.tuning),
        declarations="extern const fsw_decentral_tuning fsw_decentral_gains;\n",
        start="&fsw_decentral_gains",
        input_type="fsw_decentral_input",
        output_type="fsw_decentral_output",
        inputs=DECENTRAL_INPUTS,
        outputs=DECENTRAL_OUTPUTS,
    )
