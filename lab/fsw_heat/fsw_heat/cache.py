"""Keeps reductions: one file for each geometry and version of the sources, in the user's cache."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from fsw_control.schema.files import replacing, user_cache
from fsw_control.schema.models import InputError
from fsw_heat.projection import Progress, Projection, project
from fsw_plant.canister import CanisterParameters

#: fields of :class:`CanisterParameters` that finite elements and projection depend on; the others
#: may change afterwards
_SHAPE = (
    "shape",
    "outer_radius_mm",
    "wall_mm",
    "rim_mm",
    "lid_mm",
    "lid_from_mm",
    "tube_mm",
    "probe_radius_mm",
    "probe_length_mm",
    "shoulder_radius_mm",
    "clamp_from_mm",
    "clamp_to_mm",
    "lowest_mm",
    "element_mm",
    "tolerance_k",
    "modes",
)
Kind = TypeVar("Kind")


def _shape(parameters: CanisterParameters, kind: type[Any]) -> str:
    """What a reduction depends on: geometry, discretisation and the sources that made it."""
    digest = hashlib.sha256()
    for name in (
        "elements.py",
        "projection.py",
        *(["compaction.py"] if kind is not Projection else []),
    ):
        digest.update((Path(__file__).parent / name).read_bytes())
    values = parameters.model_dump()
    return json.dumps(
        {name: values[name] for name in _SHAPE} | {"sources": digest.hexdigest()[:16]}
    )


def cache_path(
    parameters: CanisterParameters, folder: Path | None = None, kind: type[Any] = Projection
) -> Path:
    """File of a geometry's projection or another reduction, by default in the user's cache."""
    digest = hashlib.sha256(_shape(parameters, kind).encode()).hexdigest()[:16]
    return (
        folder or user_cache("fsw_canister")
    ) / f"{'canister' if kind is Projection else 'compact'}-{digest}.npz"


def projection_of(
    parameters: CanisterParameters, cache: Path | None = None, progress: Progress | None = None
) -> Projection:
    """A projection from the cache or made now; see :func:`fsw_heat.reduced.load_or_reduce`."""
    return kept(Projection, parameters, cache, lambda: project(parameters, progress), progress)


def kept(
    kind: type[Kind],
    parameters: CanisterParameters,
    cache: Path | None,
    make: Callable[[], Kind],
    progress: Progress | None = None,
) -> Kind:
    """A reduction, a dataclass of arrays, from the cache or made now and kept.

    See ``reduced.load_or_reduce``.
    """
    given, shape = cache is not None and cache.suffix == ".npz", _shape(parameters, kind)
    path = cache if cache is not None and given else cache_path(parameters, cache, kind)
    reduction = _read(path, kind, shape, refuse=given)
    if reduction is None:
        reduction = make()
        try:
            _write(path, reduction, shape)
        except OSError as error:
            if progress:
                progress(
                    1.0,
                    f"not kept for the next time: {path}: {error.strerror} (set XDG_CACHE_HOME)",
                )
    return reduction


def _read(path: Path, kind: type[Kind], shape: str, refuse: bool) -> Kind | None:
    """What a file holds, if it is there and whole.

    One of another shape is refused or made again.
    """
    try:
        with np.load(path, allow_pickle=False) as content:
            was = json.loads(str(content["shape"]))
            arrays = {field.name: content[field.name] for field in fields(cast("Any", kind))}
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        if refuse:
            raise InputError(
                f"{path}: holds no reduced canister; remove it, and the next run computes it"
            ) from None
        return None
    wanted = json.loads(shape)
    if was == wanted:
        return kind(**arrays)
    if refuse:
        other = next(name for name in wanted if was.get(name) != wanted[name])
        what = f"{other} {was.get(other)}, not {wanted[other]}"
        raise InputError(
            f"{path}: reduced for another canister ({what}); give another place or remove it"
        )
    return None


def _write(path: Path, reduction: Any, shape: str) -> None:
    """Replaced at once, so that no process ever reads half a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as scratch:
        arrays = {field.name: getattr(reduction, field.name) for field in fields(reduction)}
        np.savez(scratch, shape=np.array(shape), **arrays)
