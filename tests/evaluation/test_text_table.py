"""Figures as text."""

from crowdfence.evaluation.text_table import percent


def test_nobody_is_rounded_away() -> None:
    """Of 10 000 people 3 are missed: that is not 100.0%, and 3 on ground called empty are not 0.0%."""
    assert [percent(share) for share in (0.0, 0.0003, 0.0006, 0.9994, 0.9997, 1.0)] == [
        "0.0%", "<0.1%", "0.1%", "99.9%", ">99.9%", "100.0%",
    ]  # fmt: skip
    assert percent(float("nan")) == "-"
