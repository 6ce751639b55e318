"""The error of campaigns."""


class CampaignError(ValueError):
    """A campaign cannot be read, run, continued or reported; the message says what, where and what to do."""
