"""Why a zone is closed, in words for people."""

REASONS = {
    "seen": "a drone saw crowd in it at this instant",
    "not_cleared": "drones looked at it at this instant and saw too little to be sure that nobody is there",
    "not_looked_at": "crowd was seen, and nobody has looked since",
    "held": "its probability is below the threshold at which zones begin, not below that at which they end",
    "never_cleared": "never seen, hidden, or seen too long ago: not known to be empty",
    "given": "somebody else closed it",
}
