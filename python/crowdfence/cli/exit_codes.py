"""What a command tells a shell beside its words. 2, for usage, is the command line library's."""

FAILED = 1
GATE_NOT_MET = 3
"""The work was done, and what it found is not good enough to go on without a look."""
INTERRUPTED = 130
ENDED = 143
"""128 and the number of the signal, as shells count."""
