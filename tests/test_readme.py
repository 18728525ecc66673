"""What the README shows is what happens."""

import contextlib
import io
import re
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"


def test_the_python_example_runs_and_finds_the_crowd_it_draws() -> None:
    (example,) = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(example, str(README), "exec"), {})
    never_seen, occluded, empty, stale, crowd = map(int, re.findall(r"\d+", printed.getvalue()))
    # Two by two heatmap cells of four pixels: at 19 m and f = 40 that is 3.8 m, at most 5 x 5 voxels.
    assert 9 <= crowd <= 25
    # The image covers 64 / 40 * 19 = 30.4 by 22.8 m of the plain.
    assert 29 * 22 <= empty + crowd <= 32 * 24
    assert never_seen + empty + crowd == 60 * 60
    assert occluded == stale == 0


def test_the_status_table_names_no_command_that_is_missing() -> None:
    from typer.main import get_command

    from crowdfence.cli.app import app

    known = set(get_command(app).commands)  # type: ignore[attr-defined]
    shown = set(re.findall(r"^crowdfence (\w+)", README.read_text(), re.MULTILINE))
    assert shown and shown <= known
