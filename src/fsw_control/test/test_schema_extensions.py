"""Entry points of distributions, those of the user as well, and extras that are installed at first use."""

from collections.abc import Iterator
from importlib import invalidate_caches
from pathlib import Path

import pytest

from fsw_control.schema import extensions as extras
from fsw_control.schema.extensions import Extra, MissingExtraError, all_loaded, extensions, loaded
from fsw_control.schema.models import InputError

GROUP = "fsw.group_of_a_test"


@pytest.fixture(autouse=True)
def _forgotten() -> Iterator[None]:
    extensions.cache_clear()
    yield
    extensions.cache_clear()


def install(folder: Path, name: str, *points: str) -> None:
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("\n".join([f"[{GROUP}]", *points]))
    invalidate_caches()
    extensions.cache_clear()


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_those_of_all_distributions_are_sorted_and_loaded(site: Path) -> None:
    install(site, "second", "length = builtins:len")
    install(site, "first", "zero = builtins:int", "absolute = builtins:abs")
    assert list(extensions(GROUP)) == ["absolute", "length", "zero"]
    assert all_loaded(GROUP) == {"absolute": abs, "length": len, "zero": int}
    assert loaded(GROUP, "nobody") is None


def test_the_same_one_twice_is_one_and_another_of_its_name_is_refused(site: Path) -> None:
    install(site, "first", "length = builtins:len")
    install(site, "second", "length = builtins:len")
    assert loaded(GROUP, "length") is len
    install(site, "third", "length = builtins:max")
    with pytest.raises(InputError) as caught:
        extensions(GROUP)
    assert all(name in str(caught.value) for name in (GROUP, "length", "third", "builtins:max"))


@pytest.mark.parametrize(
    "value", ["no_such_module_of_a_test:f", "builtins:no_such_name", "broken_module_of_a_test"]
)
def test_one_that_cannot_be_loaded_names_its_distribution(site: Path, value: str) -> None:
    (site / "broken_module_of_a_test.py").write_text("1 / 0\n")
    install(site, "broken", f"bad = {value}")
    with pytest.raises(InputError) as caught:
        loaded(GROUP, "bad")
    assert "(broken)" in str(caught.value) and value in str(caught.value)


def test_an_extra_is_installed_at_first_use_where_that_is_possible(
    site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    extra = Extra("some-distribution", "some_extra", ("module_of_some_extra",))
    with pytest.raises(MissingExtraError, match="module_of_some_extra") as caught:
        extra.need("it")
    assert "pip install" not in str(caught.value)  # pip would look for a stranger's distribution
    install(site, "some_distribution")
    assert extra.absence.endswith("pip install 'some-distribution[some_extra]'")
    installs = []

    def installed(name: str) -> None:
        installs.append(name)
        (site / "module_of_some_extra.py").write_text("VALUE = 3\n")

    monkeypatch.setattr(extras, "install", installed)
    assert extra.module("module_of_some_extra", "it").VALUE == 3
    assert extra.missing() == [] and installs == ["some_extra"]


def test_an_extra_that_cannot_be_installed_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "install", lambda name: None)
    assert Extra("some-distribution", "some_extra", ("os", "no_module_at_all")).missing() == [
        "no_module_at_all"
    ]
