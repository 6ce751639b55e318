"""The cache of projections."""

import functools
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fsw_control.schema.models import InputError
from fsw_heat import cache, load_or_reduce
from fsw_heat.cache import cache_path
from fsw_heat.projection import Projection, project
from fsw_plant.canister import CanisterParameters

TINY = CanisterParameters(
    outer_radius_mm=60.0, wall_mm=20.0, rim_mm=40.0, lid_mm=0.0, tube_mm=100.0, lowest_mm=-5.0, probe_radius_mm=15.0,
    probe_length_mm=20.0, shoulder_radius_mm=20.0, clamp_from_mm=60.0, clamp_to_mm=80.0, element_mm=5.0, modes=12,
)  # fmt: skip


@functools.cache
def _projection() -> Projection:
    return project(TINY)


class TestCache:
    """A projection is made once for each geometry."""

    @pytest.fixture(autouse=True)
    def _needs_finite_elements(self) -> None:
        pytest.importorskip(
            "skfem",
            reason="scikit-fem is not installed: pip install -r requirements/canister.lock",
        )

    @pytest.fixture
    def made(self, monkeypatch: pytest.MonkeyPatch) -> list[CanisterParameters]:
        """What a projection was made for.

        All get that of the tiny canister, which is computed once.
        """
        asked: list[CanisterParameters] = []

        def project(parameters: CanisterParameters, _progress: object) -> Projection:
            asked.append(parameters)
            return _projection()

        monkeypatch.setattr(cache, "project", project)
        return asked

    def test_reduction_is_computed_once_and_cached(self, tmp_path: Path) -> None:
        shares: list[float] = []
        first = load_or_reduce(TINY, tmp_path, lambda share, _text: shares.append(share))
        assert shares == sorted(shares) and shares[-1] == 1.0
        assert [path.name for path in tmp_path.iterdir()] == [cache_path(TINY).name]
        shares.clear()
        again = load_or_reduce(TINY, tmp_path, lambda share, _text: shares.append(share))
        assert not shares
        states = [model.step(model.initial(), 5.0, 1.0, 0.0, 7.0) for model in (first, again)]
        assert np.array_equal(states[0].modes, states[1].modes)

    def test_concurrent_processes_may_write_the_same_cache(self, tmp_path: Path) -> None:
        """One begins and ends while the other is half-way; a third finds what they left."""
        code = (
            "import sys; from pathlib import Path; "
            "from fsw_plant.canister import CanisterParameters;from fsw_heat import "
            "load_or_reduce;load_or_reduce(CanisterParameters.from_yaml(sys.argv[1]), "
            "Path(sys.argv[2]))"
        )
        seen: list[float] = []

        def meanwhile(share: float, _text: str) -> None:
            if not seen and share >= 0.5:
                subprocess.run(
                    [sys.executable, "-c", code, json.dumps(TINY.model_dump()), str(tmp_path)],
                    check=True,
                )
                seen.append(cache_path(TINY, tmp_path).stat().st_ino)

        slow = load_or_reduce(TINY, tmp_path, meanwhile)
        assert [path.name for path in tmp_path.iterdir()] == [cache_path(TINY).name]
        assert [cache_path(TINY, tmp_path).stat().st_ino] != seen  # replaced as a whole
        reduction = load_or_reduce(TINY, tmp_path, lambda _share, text: pytest.fail(text))
        states = [model.step(model.initial(), 5.0, 1.0, 0.0, 7.0) for model in (slow, reduction)]
        assert np.array_equal(states[0].modes, states[1].modes)

    def test_cache_depends_on_geometry_not_on_copper_and_losses(self) -> None:
        other = TINY.changed(
            conductivity_w_per_m_k=300.0, ambient_c=5.0, emissivity=0.8, shoulder_share=0.1
        )
        assert cache_path(other) == cache_path(TINY)
        assert cache_path(TINY.changed(wall_mm=20.5)) != cache_path(TINY)

    def test_damaged_cache_is_replaced(
        self, tmp_path: Path, made: list[CanisterParameters]
    ) -> None:
        load_or_reduce(TINY, tmp_path)
        path = cache_path(TINY, tmp_path)
        whole = path.read_bytes()
        for content in (b"", b"no archive", whole[: len(whole) // 2]):
            path.write_bytes(content)
            assert load_or_reduce(TINY, tmp_path).states > 0
            assert len(path.read_bytes()) == len(whole)
        assert made == [TINY] * 4

    @pytest.mark.usefixtures("made")
    def test_a_given_file_of_another_geometry_is_refused(self, tmp_path: Path) -> None:
        path = tmp_path / "mine.npz"
        load_or_reduce(TINY, path)
        with pytest.raises(InputError, match=r"mine\.npz: .*\(wall_mm 20\.0, not 20\.5\)"):
            load_or_reduce(TINY.changed(wall_mm=20.5), path)
        path.write_text("x")
        with pytest.raises(InputError, match=r"mine\.npz.* no reduced"):
            load_or_reduce(TINY, path)

    @pytest.mark.usefixtures("made")
    def test_unwritable_cache_is_skipped(self, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("")
        texts: list[str] = []
        assert (
            load_or_reduce(
                TINY, tmp_path / "file" / "x", lambda _share, text: texts.append(text)
            ).states
            > 0
        )
        assert "not kept" in texts[-1]
