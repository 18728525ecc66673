"""What `crowdfence fence watch --json` prints in a process of its own."""

import json
import subprocess
from typing import Any


def events_of(process: subprocess.Popen[str], wanted: str) -> list[dict[str, Any]]:
    """Lines that `watch --json` prints, up to an event."""
    assert process.stdout is not None
    events = []
    for line in process.stdout:
        events.append(json.loads(line))
        if events[-1]["event"] == wanted:
            return events
    raise AssertionError((wanted, events))
