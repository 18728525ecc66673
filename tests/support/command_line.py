"""The real command line, in a process of its own."""

import os
import subprocess
import sys


def crowdfence(*arguments: object, columns: int = 120, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run `crowdfence ARGUMENTS` without colours on a terminal of so many columns; `variables` are added to
    its environment."""
    return subprocess.run(
        [sys.executable, "-m", "crowdfence", *map(str, arguments)],
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": str(columns), "NO_COLOR": "1", **variables},
        timeout=300,
        check=False,
    )
