"""Names that users chose, as a picture can show them."""

from functools import cache


def drawn(name: str) -> str:
    """Characters that the font of pictures lacks are told by their number, so that names stay apart, and no
    sign begins a formula."""
    known = _known_characters()
    shown = (one if ord(one) in known else f"U+{ord(one):04X}" for one in name)
    return "".join(shown).replace("$", r"\$")


@cache
def _known_characters() -> frozenset[int]:
    from matplotlib.font_manager import FontProperties, findfont, get_font

    return frozenset(get_font(findfont(FontProperties())).get_charmap())
