"""What holds for every test."""

from hypothesis import settings

# How long an example takes is the machine's business: no test asserts a wall time, Hypothesis's default does.
settings.register_profile("without deadline", deadline=None)
settings.load_profile("without deadline")
