"""What a command tells a shell beside its words."""

FAILED = 1
INTERRUPTED = 130
"""128 and the number of the signal, as shells count."""
