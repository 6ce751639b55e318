"""Which topics are recorded or replayed, and with which QoS."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from fsw_recorder.bag_metadata import OfferedQos
from fsw_recorder.errors import BagError


@dataclass(frozen=True, slots=True)
class TopicSelection:
    """Rule that takes or leaves topics.

    Attributes
    ----------
    topics : tuple[str, ...]
        Names to take; empty takes all that `regex` takes.
    regex : str
        Takes topics whose whole name matches; empty takes all.
    exclude : tuple[str, ...]
        Names to leave.
    exclude_regex : str
        Leaves topics in whose name it is found; empty leaves none.
    include_hidden : bool
        Whether to take topics of which a part of the name begins with an underscore.

    Raises
    ------
    BagError
        An expression is not valid.
    """

    topics: tuple[str, ...] = ()
    regex: str = ""
    exclude: tuple[str, ...] = ()
    exclude_regex: str = ""
    include_hidden: bool = False
    _take: re.Pattern[str] | None = field(init=False, repr=False, compare=False, default=None)
    _leave: re.Pattern[str] | None = field(init=False, repr=False, compare=False, default=None)

    def __post_init__(self) -> None:
        for name, text in (("_take", self.regex), ("_leave", self.exclude_regex)):
            try:
                object.__setattr__(self, name, re.compile(text) if text else None)
            except re.error as error:
                raise BagError(f"'{text}' is not a regular expression: {error}") from None

    def takes(self, topic: str) -> bool:
        """Whether the topic is taken."""
        if topic in self.exclude or (self._leave is not None and self._leave.search(topic)):
            return False
        if topic in self.topics:
            return True
        if not self.include_hidden and any(part.startswith("_") for part in topic.split("/")):
            return False
        if self.topics and not self.regex:
            return False
        return self._take is None or self._take.fullmatch(topic) is not None


def requested_qos(offers: Sequence[OfferedQos], depth: int) -> OfferedQos:
    """QoS of a subscription that hears all of the publishers: the strongest that each of them offers.

    Parameters
    ----------
    offers : sequence of OfferedQos
        Of the publishers.
    depth : int
        Of the subscription's queue; a publisher's larger depth wins, so that all latched messages are heard.
    """
    reliable = bool(offers) and all(one.reliability == "reliable" for one in offers)
    latched = bool(offers) and all(one.durability == "transient_local" for one in offers)
    return OfferedQos(
        reliability="reliable" if reliable else "best_effort",
        durability="transient_local" if latched else "volatile",
        depth=max([depth, *(one.depth for one in offers)]),
    )


def hears(request: OfferedQos, offer: OfferedQos) -> bool:
    """Whether a subscription that asks for ``request`` is matched with a publisher that offers ``offer``."""
    reliable = offer.reliability == "reliable" or request.reliability != "reliable"
    latched = offer.durability == "transient_local" or request.durability != "transient_local"
    return reliable and latched


def strongest_first(offers: Sequence[OfferedQos]) -> list[OfferedQos]:
    """Offers in an order in which no later one is stronger than an earlier one."""

    def weakness(one: OfferedQos) -> tuple[int, str]:
        return (one.reliability != "reliable") + (one.durability != "transient_local"), repr(one)

    return sorted(offers, key=weakness)


def replayed_qos(offers: Sequence[OfferedQos]) -> OfferedQos:
    """QoS of a publisher that every subscription of the recorded publishers also hears: the strongest of them."""
    if not offers:
        return OfferedQos()
    return OfferedQos(
        reliability="reliable" if any(one.reliability == "reliable" for one in offers) else "best_effort",
        durability="transient_local" if any(one.durability == "transient_local" for one in offers) else "volatile",
        depth=max(1, *(one.depth for one in offers)),
    )
