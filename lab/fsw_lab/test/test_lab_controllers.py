"""A user's own controller in a campaign."""

import pytest
import yaml

from fsw_campaign import definition
from fsw_campaign.welds import run_weld
from fsw_schema.models import InputError
from fsw_test_support.own_controller import own

pytestmark = pytest.mark.usefixtures("forgotten")


def test_a_campaign_runs_it_and_depends_on_its_source(tmp_path):
    label = own(tmp_path)
    file = tmp_path / "campaign.yaml"
    file.write_text(
        yaml.safe_dump(
            {"name": "c", "scenario": "quick", "controllers": [label, "decentral"], "welds": 1}
        )
    )
    campaign = definition.load(file)
    assert [one.label for one in campaign.entrants] == ["own", "decentral"]
    assert run_weld(campaign, 0, campaign.parameters(0), campaign.entrants[0])["status"] == "ok"
    before = campaign.digest
    own(tmp_path, "return Proposal(Command(80.0, 400.0))")
    assert campaign.digest != before
    file.write_text(file.read_text().replace("own.py:Own", "own.py:None"))
    with pytest.raises(InputError, match="no class None"):
        definition.load(file)
