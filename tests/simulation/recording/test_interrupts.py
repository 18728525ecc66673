"""A helping process that is asked to end hands over what it has begun."""

import subprocess
import sys

import pytest

ASKED = """
import os, signal, time
from crowdfence.simulation.recording.interrupts import end_between_tasks, end_if_wanted
end_between_tasks()
os.kill(os.getpid(), signal.SIGTERM)
print("handed over", flush=True)
"""


@pytest.mark.parametrize("then", ["end_if_wanted()", "time.sleep(60)"])
def test_it_ends_at_its_next_task_or_without_one(then: str) -> None:
    """Killed in the middle of a result, it left the parent waiting for the rest."""
    code = f"{ASKED}{then}\nprint('went on')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=50)
    assert (done.returncode, done.stdout) == (1, "handed over\n")
