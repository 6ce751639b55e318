"""Constants shared by the time types."""

S_TO_NS = 1_000_000_000
INT64_MAX = 2**63 - 1
INT64_MIN = -(2**63)
