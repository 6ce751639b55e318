"""Parameters of the operator's page. Chosen means: not in the paper, chosen for this project."""

from __future__ import annotations

from typing import Annotated

from fsw_control.parameters import AT_START, NodeParameters
from fsw_control.schema.models import Many, Whole
from fsw_control.schema.ranges import Range


class HmiParameters(NodeParameters):
    """Parameters of the operator's page."""

    host: Annotated[str, AT_START] = "127.0.0.1"
    """Address to listen on; another than this computer's own is not encrypted, see the how-to."""
    port: Annotated[Whole, Range(0, 65535, ""), AT_START] = 8080
    """Port to listen on; 0: any free one."""
    token_file: Annotated[str, AT_START] = ""
    """File that holds the token for commands, for its owner alone to read; empty: a new token is
    printed at every start."""
    users_file: Annotated[str, AT_START] = ""
    """File of named users, for its owner alone to read, made by 'fsw.py hmi user'; empty: the
    token counts."""
    tls_cert: Annotated[str, AT_START] = ""
    """Certificate in PEM by which the page is encrypted, with the chain behind it; empty: it is
    not."""
    tls_key: Annotated[str, AT_START] = ""
    """Private key of the certificate in PEM without a password, for its owner alone to read."""
    handover_timeout_s: Annotated[float, Range(0.0, 3600.0, "s"), AT_START] = 30.0
    """Time after which control that was asked for may be taken when who has it does not answer
    (chosen)."""
    local_stop: Annotated[bool, AT_START] = True
    """Whether pages on this computer may ask for a safe stop without login; false if a proxy on
    this computer serves others."""
    allow_hosts: Annotated[Many[str], AT_START] = ()
    """Further names and addresses under which browsers ask for the page."""
    pages_folder: Annotated[str, AT_START] = ""
    """Folder that pages of other distributions show to users, as the history of welds; empty: no
    such pages."""
    request_timeout_s: Annotated[float, Range(0.1, 60.0, "s")] = 3.0
    """Time for which the graph's answer to a request is waited for (chosen)."""
    procedure: Annotated[str, AT_START] = ""
    """Procedure by whose limits the weld is judged and alarms are raised, a YAML file; empty:
    those of the default rules."""
    silence_s: Annotated[float, Range(0.15, 10.0, "s")] = 0.2
    """Silence of the drives' feedback or of the commands after which that is an alarm, within a
    further 0.1 s; ten times as long in simulated time (chosen: two ticks)."""
    deviation_persistence_s: Annotated[float, Range(0.0, 600.0, "s")] = 10.0
    """Time for which the temperature must be off its set-point, or force or speed off the command,
    before that is an alarm, and back before it ends (chosen: longer than a step of the set-point
    of temperature takes)."""
    quality_persistence_s: Annotated[float, Range(0.0, 600.0, "s")] = 2.0
    """Time for which any other value must be outside a limit of the procedure or of the default
    rules before that is an alarm, and back before it ends (chosen)."""
