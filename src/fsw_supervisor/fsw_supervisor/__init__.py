"""The arbiter: the only writer of the command; checks, swaps and replaces controllers."""

from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.checks import ProposalInput
from fsw_supervisor.settings import ArbiterSettings
from fsw_supervisor.tick import Decision

__all__ = ["Arbiter", "ArbiterSettings", "Decision", "ProposalInput"]
