"""The error of identification; the command line imports it without scipy."""


class IdentificationError(ValueError):
    """Nothing can be identified from these data; the message says why and what to do."""
