"""The one exception of the detector."""


class DetectorError(ValueError):
    """A model that cannot be used, a contract that does not hold, an image of a wrong kind, or output that
    is no heatmap. The message is one line and names the model or key, the value and what is allowed."""
