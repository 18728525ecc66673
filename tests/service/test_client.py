"""`Client` before it has spoken to a service."""

import math

import pytest

from crowdfence import Client


@pytest.mark.parametrize("url", ["127.0.0.1:8080", "", "ftp://127.0.0.1", "localhost"])
def test_what_is_no_address_is_refused_at_once(url: str) -> None:
    with pytest.raises(ValueError, match=f"url is '{url}'; it must begin with http:// or https://"):
        Client(url)


@pytest.mark.parametrize("patience_s", [-1.0, math.nan])
def test_patience_is_a_time(patience_s: float) -> None:
    """With NaN a view would be given again for ever."""
    with pytest.raises(ValueError, match=rf"patience_s is {patience_s:g}; it must be at least 0"):
        Client(patience_s=patience_s)
