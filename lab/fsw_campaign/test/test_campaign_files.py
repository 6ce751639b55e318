"""Campaigns without Dask: points, rows, datasets, reports."""

import errno
import json
import os
import re
import subprocess
import sys
from datetime import UTC, datetime

import numpy as np
import pytest
import yaml

pa = pytest.importorskip("pyarrow")

from fsw_analysis.kpi import compute  # noqa: E402
from fsw_campaign import dataset, definition, report, welds  # noqa: E402
from fsw_campaign.dataset import Dataset  # noqa: E402
from fsw_campaign.definition import Bounds  # noqa: E402
from fsw_campaign.distributions import Distribution, draw, weld_seed  # noqa: E402
from fsw_campaign.statistics import Results, first_order  # noqa: E402
from fsw_campaign.welds import run_weld  # noqa: E402
from fsw_control.schema.models import InputError, validate  # noqa: E402
from fsw_recorder.findings import Code, EvidenceError  # noqa: E402
from fsw_recorder.recording import code_files  # noqa: E402
from fsw_recorder.signature import (  # noqa: E402
    Purpose,
    load_private,
    load_trusted,
    sign,
    signature_path,
)
from fsw_scenario.closed_loop import ClosedLoop  # noqa: E402
from fsw_test_support.judged_weld import short_procedure  # noqa: E402
from fsw_test_support.keys import make_key  # noqa: E402
from fsw_test_support.small_campaign import SMALL, campaign  # noqa: E402

NOW = datetime(2026, 11, 25, tzinfo=UTC)


def one(path, **entry):
    return {"distributions": {path: entry}}


def test_unwritable_folder_is_refused(small, tmp_path):
    (tmp_path / "file").write_text("x")
    folder = tmp_path / "file" / "out"
    with pytest.raises(InputError, match=re.escape(str(folder))) as raised:
        Dataset(folder, small[0])
    assert os.strerror(errno.ENOTDIR) in str(raised.value)


def test_shipped_campaigns_are_valid():
    for name in definition.shipped():
        assert definition.load(name).name == name


def test_points_depend_only_on_seed_and_number(tmp_path):
    made, again = campaign(tmp_path), campaign(tmp_path)
    assert [made.parameters(i) for i in (2, 0)] == [again.parameters(2), again.parameters(0)]
    other = campaign(tmp_path, seed=4)
    assert other.parameters(0) != made.parameters(0)
    seeds = {weld_seed(1, i) for i in range(1000)}
    assert len(seeds) == 1000 and max(seeds) < 2**32


def test_samplers_fill_the_cube_evenly():
    three = 3
    hypercube = draw(three, 20, 1, "latin_hypercube")
    assert all(sorted((column * 20).astype(int)) == list(range(20)) for column in hypercube.T)
    assert np.array_equal(draw(three, 64, 1, "sobol")[:20], draw(three, 20, 1, "sobol"))
    assert draw(0, 5, 1, "sobol").shape == (5, 0)


@pytest.mark.parametrize(
    ("entry", "quantiles"),
    [
        ({"uniform": [2.0, 4.0]}, [2.0, 2.5, 4.0]),
        ({"loguniform": [0.01, 100.0]}, [0.01, 0.1, 100.0]),
        (
            {"normal": {"mean": 0.0, "deviation": 1.0, "low": -50.0, "high": 50.0}},
            [-50.0, -0.6744897501960817, 50.0],
        ),
        (
            {"normal": {"mean": 0.0, "deviation": 1.0, "low": 0.0, "high": 50.0}},
            [0.0, 0.31863936396437514, 50.0],
        ),
        ({"choice": ["a", "b", "c"]}, ["a", "a", "c"]),
    ],
)
def test_quantiles_of_distributions(entry, quantiles):
    made = validate(Distribution, entry, "test")
    quantile_values = [made.value(share) for share in (0.0, 0.25, 1.0)]
    assert quantile_values == (quantiles if "choice" in entry else pytest.approx(quantiles))


def test_a_weld_has_one_plant_and_one_noise_under_all_controllers(small):
    made, _ = small
    first, second = (made.weld(made.parameters(1), entrant) for entrant in made.entrants)
    assert first.plant == second.plant and first.events == second.events
    assert made.weld(made.parameters(2), made.entrants[0]).plant["seed"] != first.plant["seed"]


def test_a_row_has_all_figures_of_merit(small):
    made, rows = small
    columns = set(dataset.schema(made).names)
    assert set(rows[0]) - columns == set()
    scenario = made.weld(made.parameters(0), made.entrants[0])
    figures = compute(ClosedLoop(scenario, made.controllers(scenario, made.entrants[0])).run())
    for key, value in figures.items():
        if key not in ("label", "controllers", "outputs"):
            assert rows[0][key] == value, key
    assert {event for row in rows for entry in row["events"] for event in entry} <= {
        f.name for f in dataset.EVENT
    }


def test_limits_are_judged_on_the_true_outputs(small):
    _, rows = small
    for row in rows:
        assert row["status"] == "ok"
        assert row["inside"] == (row["outside_depth_error_mm_s"] <= 1.0)
        assert row["highest_depth_error_mm"] - row["lowest_depth_error_mm"] > 0.09
    assert len({row["inside"] for row in rows}) == 2


PHASES = [
    {"name": "dwell", "duration_s": 1.0, "source": "test"},
    {"name": "joint_line", "to_deg": 1.0, "source": "test"},
]
WELD = {
    "name": "short_weld",
    "controller": "decentral",
    "plant": {"seed": 3},
    "phases": [
        {"name": "dwell", "duration_s": 1.0},
        {"name": "joint_line", "to_deg": 1.0, "speed_mm_per_min": 120.0},
    ],
}


@pytest.mark.parametrize(
    ("changes", "verdict", "rule"),
    [
        ({}, "accept", "all"),
        (
            {"phases": [*PHASES, {"name": "overlap", "to_deg": 2.0, "source": "test"}]},
            "reject",
            "complete",
        ),
        ({"controllers": [{"name": "nmpc"}]}, "review", "controller"),
        (
            {"quality": [{"variable": "depth_mm", "max": 2.5, "source": "test"}]},
            "review",
            "quality",
        ),
    ],
)
def test_welds_are_judged_by_the_procedure(tmp_path, changes, verdict, rule):
    procedure = short_procedure(**changes).model_dump(mode="json", exclude_none=True)
    (tmp_path / "lid.yaml").write_text(yaml.safe_dump(procedure))
    made = campaign(
        tmp_path,
        scenario=WELD,
        distributions={},
        limits={},
        procedure="lid.yaml",
        controllers=["decentral"],
    )
    assert (
        definition.read(json.loads(made.text)).book == made.book and made.book.id == "copper_lid"
    )
    row = run_weld(made, 0, {"plant.seed": 1}, made.entrants[0])
    assert (row["status"], row["reason"], row["verdict"], row["rule"]) == ("ok", "", verdict, rule)


def test_campaign_requires_the_signature_of_its_procedure(tmp_path):
    pytest.importorskip(
        "securesystemslib", reason="not installed: pip install -r requirements/signing.lock"
    )
    path = tmp_path / "lid.yaml"
    path.write_text(yaml.safe_dump(short_procedure().model_dump(mode="json", exclude_none=True)))
    file = tmp_path / "campaign.yaml"
    file.write_text(
        yaml.safe_dump(
            {
                "name": "signed",
                "scenario": WELD,
                "welds": 1,
                "procedure": "lid.yaml",
                "controllers": ["decentral"],
            }
        )
    )
    for name in ("own", "foreign"):
        make_key(tmp_path / name)
    own = load_trusted([tmp_path / "own.pub"])
    assert definition.load(file).book.id == "copper_lid"
    with pytest.raises(EvidenceError) as caught:
        definition.load(file, trusted=own, require_signed=True)
    assert caught.value.findings[0].code is Code.NOT_SIGNED
    for name, code in (("own", None), ("foreign", Code.KEY_UNKNOWN)):
        text = sign(
            path.read_bytes(), path.name, Purpose.PROCEDURE, load_private(tmp_path / name), NOW
        )
        signature_path(path).write_text(text)
        if code is None:
            assert definition.load(file, trusted=own, require_signed=True).book.id == "copper_lid"
            continue
        for demanded in ({"trusted": own}, {"require_signed": True}):
            with pytest.raises(EvidenceError) as caught:
                definition.load(file, **demanded)
            assert caught.value.findings[0].code is code
    path.write_text(path.read_text() + "# changed\n")
    with pytest.raises(EvidenceError) as caught:
        definition.load(file)
    assert caught.value.findings[0].code is Code.CONTENT_CHANGED


def test_invalid_procedure_is_refused(tmp_path):
    with pytest.raises(InputError, match="procedure"):
        campaign(tmp_path, procedure={"id": "lid"})


def test_failed_weld_is_a_row(tmp_path):
    made = campaign(tmp_path, **one("plant.start.temperature_c", uniform=[816.4, 1000.0]))
    hot = run_weld(
        made, 0, {"plant.seed": 1, "plant.start.temperature_c": 1000.0}, made.entrants[0]
    )
    assert hot["status"] == "error" and "beyond the drives" in hot["reason"] and not hot["inside"]
    made = campaign(tmp_path, **one("plant.factors.depth_gain_mm_per_kn_s", uniform=[1.0, 10.0]))
    parameters = {"plant.seed": 1, "plant.factors.depth_gain_mm_per_kn_s": 10.0}
    lost = run_weld(
        made, 1, parameters | {"events[2].disturbance.channel": "temperature"}, made.entrants[0]
    )
    assert lost["status"] == "error"  # amplitude_mm is no key of that channel
    with Dataset(tmp_path / "out", made) as written:
        written.write([hot | parameters, lost])
    assert dataset.load(tmp_path / "out")[1]["status"].to_pylist() == ["error", "error"]


def test_dataset_is_continued_and_others_are_refused(small, tmp_path):
    made, rows = small
    folder = tmp_path / "out"
    with Dataset(folder, made) as written:
        written.write(rows[:3])
        assert written.missing() == [
            (1, ["mine"]),
            (2, ["decentral:tight", "mine"]),
            (3, ["decentral:tight", "mine"]),
        ]
        with pytest.raises(InputError, match="another run"):
            Dataset(folder, made, resume=True)
    with pytest.raises(InputError, match="--resume"):
        Dataset(folder, made)
    with pytest.raises(InputError, match="another campaign"):
        Dataset(folder, campaign(tmp_path, seed=4), resume=True)
    (folder / "welds" / ".00000001.0a1b2c3d.tmp.parquet").write_text("cut off")
    with Dataset(folder, made, resume=True) as written:
        written.write(rows[3:])
        assert not written.missing()
    table = dataset.load(folder)[1]
    assert [row["index"] for row in table.to_pylist()] == [0, 0, 1, 1, 2, 2, 3, 3]
    assert not list((folder / "welds").glob(".*"))
    (joined,) = (folder / "welds").iterdir()
    (folder / "welds" / "00000001.parquet").write_bytes(
        joined.read_bytes()
    )  # as if cut off while files are joined
    assert dataset.load(folder)[1].equals(table)
    (folder / "welds" / "00000001.parquet").write_text("broken")
    with pytest.raises(InputError, match="damaged"):
        dataset.load(folder)
    manifest = json.loads((folder / "campaign.json").read_text())
    (folder / "campaign.json").write_text(json.dumps(manifest | {"versions": "other"}))
    with pytest.raises(InputError, match="other software"):
        Dataset(folder, made, resume=True)


def test_foreign_folder_is_not_changed(small, tmp_path):
    (tmp_path / "precious").write_text("x")
    with pytest.raises(InputError, match=re.escape(str(tmp_path))):
        Dataset(tmp_path, small[0])
    assert [path.name for path in tmp_path.iterdir()] == ["precious"]


def test_statistics_of_a_campaign(folder):
    made, table = dataset.load(folder)
    results = Results(made, table, folder)
    assert results.labels == ["decentral:tight", "mine"]
    assert results.complete.tolist() == [0, 1, 3]
    _, total = results.count(results.inside, "mine")
    assert total == 4
    ratio = results.ratio("iae_depth_mm_s", "mine")
    assert ratio == pytest.approx(
        results.numbers("iae_depth_mm_s", "mine")
        / results.numbers("iae_depth_mm_s", results.labels[0])
    )
    assert set(results.sensitivities("iae_depth_mm_s", "mine")) == set(SMALL["distributions"])
    assert results.meets({"iae_depth_mm_s": Bounds(min=0.0, max=1e9)}).sum() == 6
    worst = results.worst()
    assert [row["index"] for row, _ in worst[:2]] == [2, 2] and worst[0][1] == "diverged: lost"


def test_mixed_versions_are_reported(small, tmp_path):
    made, rows = small
    with Dataset(tmp_path / "mixed", made) as written:
        written.write([row | {"versions": "new" if row["index"] else "old"} for row in rows])
    page = report.write(tmp_path / "mixed", tmp_path / "page.md").read_text()
    [mixed] = [line for line in page.splitlines() if "Mixed versions: " in line]
    assert re.search(r"\b6 .*\bnew; 2 .*\bold\b", mixed)
    worst = (tmp_path / "page_worst.md").read_text()
    assert "(page_worst.md)" in page and "python3 scripts/fsw.py simulate" in worst


def test_first_order_index_of_known_functions():
    generator = np.random.default_rng(1)
    x, other = generator.uniform(-1.0, 1.0, (2, 4000))
    assert first_order(x, x) == pytest.approx(1.0, abs=0.01)
    assert first_order(x, x**2) == pytest.approx(1.0, abs=0.03)  # whose rank correlation is 0
    assert first_order(x, x + other) == pytest.approx(0.5, abs=0.05)
    assert first_order(other, x) == pytest.approx(0.0, abs=0.01)
    assert np.isnan(first_order(x[:60], x[:60]))


def test_digest_covers_all_packages_that_compute_a_weld():
    program = (
        "import sys; from fsw_campaign import definition, welds;made = definition.read({'name': "
        "'a', 'scenario': {'name': 's', 'duration_s': 1.0}, "
        "'welds': 1,'controllers': ['decentral', "
        "'nmpc:default']});rows = welds.run_batch(made.text, [(0, made.parameters(0), "
        "['decentral', 'nmpc:default'])]);assert [row['status'] for row in rows] == ['ok', 'ok'], "
        "rows;print(*(module.__file__ for name, module in sys.modules.items() "
        "if name.startswith('fsw_')))"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout.split()
    decides = {str(path) for package in welds.PACKAGES for path in code_files(package)}
    assert {*ran} <= decides


def test_versions_change_with_the_code(monkeypatch):
    monkeypatch.setattr(welds, "code_sha256", lambda package: "0" * 64)
    assert welds.versions.__wrapped__() != welds.versions()
