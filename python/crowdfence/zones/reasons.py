"""Why a zone is closed, as a sentence."""

REASONS = {
    "seen": "a drone saw crowd in it at this instant",
    "not_cleared": "drones looked at it at this instant and saw too little to be sure that nobody is there",
    "not_looked_at": "crowd was seen, and nobody has looked since",
    "held": "below the threshold at which zones begin, but not low, often, closely or long enough to end it",
    "never_cleared": "never seen, hidden, not cleared by looks, or seen too long ago: not known to be empty",
    "given": "somebody else closed it",
}
"""By `Reason`."""
