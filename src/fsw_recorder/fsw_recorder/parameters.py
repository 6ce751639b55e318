"""Parameters of the nodes that record and play bags."""

from __future__ import annotations

from typing import Annotated, Literal

from fsw_control.parameters import AT_START, NodeParameters
from fsw_control.schema.models import Many, Whole
from fsw_control.schema.ranges import Range


class RecorderParameters(NodeParameters):
    """Parameters of the recorder."""

    autostart: Annotated[bool, AT_START] = True
    """Configure and activate on start-up; if false, wait for lifecycle transitions."""
    output: Annotated[str, AT_START] = ""
    """Folder of the bag; must not exist. Empty: out/weld_<date>-<time> under the working
    directory."""
    number_if_taken: Annotated[bool, AT_START] = False
    """If output exists already, record to <output>_1, _2, ... instead of exiting with an error."""
    topics: Annotated[Many[str], AT_START] = ()
    """Names of topics to record; empty: all that match regex."""
    regex: Annotated[str, AT_START] = ""
    """Records topics whose whole name matches this regular expression; empty: all but those of
    welds in other namespaces than the recorder's."""
    exclude: Annotated[Many[str], AT_START] = ()
    """Names of topics to exclude."""
    exclude_regex: Annotated[str, AT_START] = ""
    """Excludes topics whose name contains a match of this regular expression."""
    include_hidden: Annotated[bool, AT_START] = False
    """Also record hidden topics (with a name component that begins with an underscore)."""
    wait_for_topics: Annotated[Many[str], AT_START] = ()
    """Topics that need a publisher before any other is recorded: then a plant that waits for
    subscribers starts only once these are recorded."""
    discovery_period: Annotated[float, Range(0.01, 10.0, "s"), AT_START] = 0.1
    """How often the graph is searched for new topics."""
    queue_depth: Annotated[Whole, Range(1, 100000, ""), AT_START] = 1000
    """Queue depth of each subscription while the recorder is busy."""
    compression: Annotated[Literal["", "zstd"], AT_START] = ""
    """Compression of the chunks."""
    max_bag_size: Annotated[Whole, Range(0, 1000000000000000, "bytes"), AT_START] = 0
    """Begin a new file beyond this size; 0: never."""
    max_bag_duration: Annotated[float, Range(0.0, 1000000.0, "s"), AT_START] = 3600.0
    """Begin a new file after this time; 0: never. Until then, a file's index is in memory: 20 MB
    per hour."""
    chunk_period: Annotated[float, Range(0.01, 1.0, "s"), AT_START] = 0.4
    """Maximum interval at which messages are passed to the operating system; after that they
    survive kill -9."""
    sync_period: Annotated[float, Range(0.0, 3600.0, "s"), AT_START] = 1.0
    """Interval at which data is flushed to the disk, so that it survives a power failure; 0: only
    at the end of a file."""
    max_cache_size: Annotated[Whole, Range(1048576, 100000000000, "bytes"), AT_START] = 268435456
    """Memory for messages not yet written to the disk."""
    manifest: Annotated[bool, AT_START] = True
    """Write manifest.json into the bag's folder when a file is closed: SHA-256 of the files and
    their chunks."""
    signing_key: Annotated[str, AT_START] = ""
    """Private key of the machine, made with 'ssh-keygen -t ed25519 -N ""', that signs
    manifest.json when the bag is closed; empty: it is not signed."""
    start_paused: Annotated[bool, AT_START] = False
    """Record nothing until ~/resume is called."""
    scenario: Annotated[str, AT_START] = ""
    """Scenario file to attach to the bag as scenario.yaml."""
    attach: Annotated[Many[str], AT_START] = ()
    """Further files to attach to the bag, under their names."""
    collect_parameters: Annotated[bool, AT_START] = True
    """Attach the parameters of the nodes of this weld, and of those outside of any namespace, to
    the bag, as parameters/<node>.yaml."""
    custom_data: Annotated[Many[str], AT_START] = ()
    """Entries key=value for metadata.yaml."""
    on_finished: Annotated[Many[str], AT_START] = ()
    """Commands to run one after another when the bag is finished, in a process of their own that
    outlives the recorder, e.g. one that writes the weld's record; {bag} stands for the bag's
    folder, where on_finished.log has their output."""


class ReplayParameters(NodeParameters):
    """Parameters of the node that plays bags."""

    bag: Annotated[str, AT_START] = ""
    """Bag to play: folder or file."""
    rate: Annotated[float, Range(0.001, 1000000.0, ""), AT_START] = 1.0
    """Playback rate; 2 plays twice as fast."""
    pace: Annotated[Literal["auto", "received"], AT_START] = "auto"
    """auto: a weld in simulated time is played according to its stamps, anything else according to
    its receive times; received: always the receive times."""
    start_offset: Annotated[float, Range(0.0, 1000000000.0, "s"), AT_START] = 0.0
    """Start time within the bag; latched topics are published first, with their last earlier
    value."""
    duration: Annotated[float, Range(0.0, 1000000000.0, "s"), AT_START] = 0.0
    """Duration to play; 0: to the end of the bag."""
    loop: Annotated[bool, AT_START] = False
    """Start over at the end."""
    start_paused: Annotated[bool, AT_START] = False
    """Wait for ~/resume or ~/play_next."""
    topics: Annotated[Many[str], AT_START] = ()
    """Names of topics to play; empty: all that match regex."""
    regex: Annotated[str, AT_START] = ""
    """Plays topics whose whole name matches this regular expression; empty: all."""
    exclude: Annotated[Many[str], AT_START] = (
        "/rosout",
        "/parameter_events",
    )
    """Names of topics to exclude."""
    exclude_regex: Annotated[str, AT_START] = ""
    """Excludes topics whose name contains a match of this regular expression."""
    clock: Annotated[Literal["auto", "bag_time", "recorded", "none"], AT_START] = "auto"
    """Content of /clock: bag_time: the time being played; recorded: the recorded /clock; none:
    nothing; auto: recorded if the bag has it."""
    clock_frequency: Annotated[float, Range(0.1, 1000.0, "Hz"), AT_START] = 40.0
    """Rate at which /clock is published in addition to with every message."""
    wait_for: Annotated[Many[str], AT_START] = ()
    """Topics that must have a matched subscriber before the first message; named n times: n
    subscribers."""
    wait_settle: Annotated[float, Range(0.0, 60.0, "s"), AT_START] = 1.0
    """Time for the discovery of subscribers before the first message."""
    wait_timeout: Annotated[float, Range(0.0, 86400.0, "s"), AT_START] = 30.0
    """Maximum time to wait for subscribers; after that playback begins with a warning."""
    exit_at_end: Annotated[bool, AT_START] = True
    """Exit after the last message; otherwise wait for ~/seek."""
