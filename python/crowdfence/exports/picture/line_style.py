"""Colours of the lines and texts, shared by map and legend."""

INK = "#23272e"
ZONE_LINE = "#4a0016"
OTHERS_STYLE = "--"
"""Of outlines of zones that somebody else drew."""
DRONE_LINES = ("#0b4f9e", "#7a2a9c", "#1c1c1c", "#00695c", "#6d4c41", "#c2188b")
MOST_LABELS = 12
"""Zones that get a label on the map, largest first; the others are outlined only."""


def drone_line(number: int) -> str:
    """Colour of the drone with this place in the list of tracks."""
    return DRONE_LINES[number % len(DRONE_LINES)]
