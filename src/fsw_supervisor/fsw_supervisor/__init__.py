"""The supervisor: the only writer of the command; arbitrates, swaps and replaces controllers."""

from fsw_supervisor.arbiter import Arbiter
from fsw_supervisor.parameters import SupervisorParameters
from fsw_supervisor.tick import Decision, ProposalInput

__all__ = ["Arbiter", "SupervisorParameters", "Decision", "ProposalInput"]
