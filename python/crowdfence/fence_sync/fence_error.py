"""A fence that was not sent, read or cleared."""

from crowdfence.errors import CrowdfenceError


class FenceError(CrowdfenceError):
    """Nothing was changed on the vehicle, or what it holds now is said; one line that says what to do."""


class Silence(FenceError):
    """The vehicle did not answer."""
