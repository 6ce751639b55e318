"""What the commands do, for use in Python: tunings, campaigns, exports."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fsw.arguments import validated
from fsw.processes import Model
from fsw.welds import Progress
from fsw_campaign import definition
from fsw_control.schema.models import InputError
from fsw_export.choice import Choice
from fsw_model import ModelParameters, nominal
from fsw_plant import PlantConfig, prepare

if TYPE_CHECKING:
    import pyarrow as pa

    from fsw_export.fmu_description import Content


@validated
def tune(
    controller: str,
    model: Model | str | Path | None = None,
    *,
    evaluations: int = 3000,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Tune a controller for a model.

    Parameters of ``decentral``'s node, or the content of a tuning file of ``nmpc``.

    Parameters
    ----------
    controller : str
        ``decentral:conservative``, ``decentral:tight`` or ``decentral:smith``, which are searched
        for, or ``nmpc``, whose tuning follows from the dead time.
    model : Model, str or Path, optional
        Of the process, as :func:`fsw.model` makes one, or its file; the paper's by default.
    evaluations : int
        Largest number of evaluations of the cost, some 0.1 s each; fewer are faster but worse.
    progress : callable, optional
        Called with the share done, 0 to 1.

    Raises
    ------
    fsw_control.schema.models.InputError
        When there is no such tuning, or the model's file is wrong.

    Examples
    --------
    >>> import fsw
    >>> gains = fsw.tune("decentral:tight", evaluations=2)
    >>> weld = fsw.simulate("quick", "decentral", parameters=gains)
    >>> fsw.tune("nmpc", fsw.model(factors={"dead_time_s": 2.0}))
    {'temperature_time_s': 1.68}
    """
    from fsw_nmpc.tuning import Tuning
    from fsw_tuning.tune_decentral import NAMES
    from fsw_tuning.tune_decentral import tune as search

    known = {f"decentral:{name}": name for name in NAMES}
    if controller not in known and controller != "nmpc":
        raise InputError(
            f"tune: {controller!r} cannot be tuned; there are {', '.join(known)}, nmpc"
        )
    if evaluations < 1:
        raise InputError(f"tune: evaluations is at least 1, not {evaluations}")
    if isinstance(model, Model):
        parameters = model.parameters
    else:
        parameters = nominal() if model is None else ModelParameters.from_file(Path(model))
    if controller == "nmpc":
        return {"temperature_time_s": Tuning.preset("default", parameters).temperature_time_s}
    return dict(search(known[controller], parameters, evaluations, progress))


@validated
def campaign(
    source: str | Path,
    folder: str | Path,
    *,
    welds: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    progress: Callable[[int], None] | None = None,
) -> pa.Table:
    """Run the welds of a campaign on Dask into a folder; returns all of them, a row each.

    Needs extra ``campaign``.

    In a script, call it under ``if __name__ == "__main__":``, because Dask starts processes.

    Parameters
    ----------
    source : str or Path
        A shipped campaign, e.g. ``model_uncertainty``, or a YAML file.
    folder : str or Path
        For the dataset; a new one unless ``resume``.
    welds : int, optional
        Of each controller, instead of the file's.
    workers : int, optional
        Processes on this machine; one per core by default.
    scheduler : str, optional
        Address of a Dask scheduler to use instead.
    resume : bool
        Whether only what is still missing in the folder is run.
    progress : callable, optional
        Called with the number of welds that are new.

    Raises
    ------
    fsw_control.schema.models.InputError
        When the campaign is wrong, or the folder cannot be used.

    Examples
    --------
    >>> import fsw, tempfile
    >>> table = fsw.campaign("model_uncertainty", tempfile.mkdtemp(), welds=1, workers=1)
    >>> table.num_rows == len(set(table.column("controller").to_pylist()))
    True
    """
    if workers is not None and workers < 1:
        raise InputError(f"campaign: workers is at least 1, not {workers}")
    from fsw_campaign import dataset, engine  # of the extra

    made = definition.load(source, welds)
    with dataset.Dataset(Path(folder), made, resume) as written:
        if len(written.done) < made.welds * len(made.entrants):
            with engine.connect(scheduler, workers) as client:
                engine.run(written, client, progress)
    return dataset.load(Path(folder))[1]


def _choice(
    unit: str,
    model: str | Path | None,
    tuning: str | Path | None,
    values: Mapping[str, Any] | None,
) -> Choice:
    model_file, tuning_file = (None if file is None else Path(file) for file in (model, tuning))
    return Choice(unit, model_file, tuning_file, dict(values or {}))


@validated
def export_c(
    controller: str,
    folder: str | Path,
    *,
    model: str | Path | None = None,
    tuning: str | Path | None = None,
    parameters: Mapping[str, Any] | None = None,
    replace: bool = False,
    progress: Progress | None = None,
) -> str:
    """Write a controller as a self-contained folder of C99, with a test that has been run.

    Returns what that printed.

    Parameters
    ----------
    controller : str
        ``nmpc`` or ``decentral``.
    folder : str or Path
    model, tuning : str or Path, optional
        Files instead of the paper's model and the default tuning.
    parameters : mapping of str to value, optional
        Of the controller's node.
    replace : bool
        Whether an earlier export in the folder is deleted.
    progress : callable, optional
        Called with the share done, 0 to 1.

    Raises
    ------
    fsw_control.schema.models.InputError
        When something of this is wrong, or the folder cannot be written.

    Examples
    --------
    >>> import fsw, pathlib, tempfile
    >>> folder = pathlib.Path(tempfile.mkdtemp()) / "decentral"
    >>> said = fsw.export_c("decentral", folder, parameters={"tuning": "tight"})
    >>> (folder / "README.md").exists()
    True
    """
    from fsw_export.c_folder import write_folder

    return write_folder(
        _choice(controller, model, tuning, parameters), Path(folder), replace, progress
    )


@validated
def export_fmu(
    unit: str,
    file: str | Path,
    *,
    model: str | Path | None = None,
    tuning: str | Path | None = None,
    parameters: Mapping[str, Any] | None = None,
    replace: bool = False,
    platforms: Sequence[str] = (),
    progress: Progress | None = None,
) -> Content:
    """Write ``plant``, ``nmpc`` or ``decentral`` as an FMU (FMI 2.0, co-simulation).

    Needs extra ``fmu``.

    Returns its content, with the variables; ``platforms`` are further ones than this machine's
    (``linux64``, ``win64``). The other arguments, and what is raised, are those of
    :func:`export_c`; ``parameters`` are also those of the plant.

    Examples
    --------
    >>> import fsw, pathlib, tempfile
    >>> content = fsw.export_fmu("decentral", pathlib.Path(tempfile.mkdtemp()) / "decentral.fmu")
    >>> content.variables[0].causality
    'input'
    """
    from fsw_export import fmu

    fmu.check_file(Path(file), replace)
    choice = _choice(unit, model, tuning, parameters)
    if choice.values.get("process") == "canister":
        prepare(
            PlantConfig.from_values(choice.values),
            (lambda share, _: progress(share)) if progress else None,
        )
    content = fmu.make(choice)
    fmu.write(content, Path(file), replace, tuple(platforms))
    return content
