"""numpy's numbers in a dataclass as those of Python: JSON, which is written last, takes no others."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np


def make_plain(record: Any) -> None:
    """In a dataclass, frozen or not, from its `__post_init__`."""
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, np.generic):
            object.__setattr__(record, field.name, value.item())
