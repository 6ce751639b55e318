"""Keeps projections: one file for each geometry and version of the sources, in the user's cache."""

from __future__ import annotations

import hashlib
import json
import zipfile
from dataclasses import fields
from pathlib import Path

import numpy as np

from fsw_canister.parameters import SHAPE, CanisterParameters
from fsw_canister.projection import Progress, Projection, project
from fsw_schema.files import replacing, user_cache
from fsw_schema.models import InputError


def _shape(parameters: CanisterParameters) -> str:
    """What a projection depends on: geometry, discretisation and the sources that made it."""
    digest = hashlib.sha256()
    for name in ("elements.py", "projection.py"):
        digest.update((Path(__file__).parent / name).read_bytes())
    values = parameters.model_dump()
    return json.dumps({name: values[name] for name in SHAPE} | {"sources": digest.hexdigest()[:16]})


def cache_path(parameters: CanisterParameters, folder: Path | None = None) -> Path:
    """Where the projection of a geometry is kept, by default in the user's cache."""
    return (
        folder or user_cache("fsw_canister")
    ) / f"canister-{hashlib.sha256(_shape(parameters).encode()).hexdigest()[:16]}.npz"


def projection_of(
    parameters: CanisterParameters, cache: Path | None = None, progress: Progress | None = None
) -> Projection:
    """A projection from the cache or made now; see :func:`fsw_canister.reduced.load_or_reduce`."""
    given = cache is not None and cache.suffix == ".npz"
    path = cache if cache is not None and given else cache_path(parameters, cache)
    found = _read(path, _shape(parameters), refuse=given)
    if found is None:
        found = project(parameters, progress)
        try:
            _write(path, found, _shape(parameters))
        except OSError as error:
            if progress:
                progress(1.0, f"not kept for the next time: {path}: {error.strerror} (set XDG_CACHE_HOME)")
    return found


def _read(path: Path, shape: str, refuse: bool) -> Projection | None:
    """What a file holds, if it is there and whole; one of another shape is refused or made anew."""
    try:
        with np.load(path, allow_pickle=False) as content:
            kept = json.loads(str(content["shape"]))
            arrays = {field.name: content[field.name] for field in fields(Projection)}
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        if refuse:
            raise InputError(f"{path}: holds no reduced canister; remove it, then it is made anew") from None
        return None
    wanted = json.loads(shape)
    if kept == wanted:
        return Projection(**arrays)
    if refuse:
        other = next(name for name in wanted if kept.get(name) != wanted[name])
        what = f"{other} {kept.get(other)}, not {wanted[other]}"
        raise InputError(f"{path}: reduced for another canister ({what}); give another place or remove it")
    return None


def _write(path: Path, projection: Projection, shape: str) -> None:
    """Replaced at once, so that no process ever reads half a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as scratch:
        arrays = {field.name: getattr(projection, field.name) for field in fields(projection)}
        np.savez(scratch, shape=np.array(shape), **arrays)
