"""The application: commands, version, and how errors leave it."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from crowdfence._core import __version__
from crowdfence.cli import console
from crowdfence.cli.align import align
from crowdfence.cli.calibrate import calibrate
from crowdfence.cli.command_line import command_line
from crowdfence.cli.convert import convert
from crowdfence.cli.data import app as data
from crowdfence.cli.demo import demo
from crowdfence.cli.detect import detect
from crowdfence.cli.doctor import doctor
from crowdfence.cli.evaluate import evaluate
from crowdfence.cli.exit_codes import FAILED, INTERRUPTED
from crowdfence.cli.explain import explain
from crowdfence.cli.export import export
from crowdfence.cli.fence import app as fence
from crowdfence.cli.given_paths import check_words
from crowdfence.cli.inspect import inspect
from crowdfence.cli.model import app as model
from crowdfence.cli.route import route
from crowdfence.cli.run import run
from crowdfence.cli.serve import serve
from crowdfence.cli.simulate import simulate
from crowdfence.cli.token import app as token
from crowdfence.cli.told_to_end import unwind_when_told_to_end
from crowdfence.cli.train import train
from crowdfence.cli.wording import in_options
from crowdfence.errors import one_line

app = typer.Typer(
    name="crowdfence",
    help="Where drones must not fly: crowds seen by the cameras of a fleet, put on a map of the terrain, as "
    "no-fly zones. New here? `crowdfence demo`, then `crowdfence run FLIGHT --terrain MAP -o out`.",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit codes: 0 ok, 1 failed, 2 usage, 3 a gate was not met. Data on stdout, progress on stderr.",
)
app.command("run")(run)
app.command("serve")(serve)
app.command("export")(export)
app.command("explain")(explain)
app.command("route")(route)
app.command("inspect")(inspect)
app.command("convert")(convert)
app.command("align")(align)
app.command("detect")(detect)
app.command("evaluate")(evaluate)
app.command("simulate")(simulate)
app.command("calibrate")(calibrate)
app.command("train")(train)
app.add_typer(fence, name="fence")
app.add_typer(model, name="model")
app.add_typer(data, name="data")
app.add_typer(token, name="token")
app.command("demo")(demo)
app.command("doctor")(doctor)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"crowdfence {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def main() -> None:
    """Run the command line; a failure is one line on stderr. CROWDFENCE_DEBUG=1 shows where it came from."""
    _open_closed_streams()
    unwind_when_told_to_end()
    try:
        check_words(sys.argv[1:])
        command_line(app)()
    except KeyboardInterrupt:
        console.fail("interrupted")
        sys.exit(INTERRUPTED)
    except ModuleNotFoundError as error:
        _reraise_for_debugging()
        console.fail(f"{error.name} is not installed; `crowdfence doctor` says how to get it")
        sys.exit(FAILED)
    except ImportError as error:
        _reraise_for_debugging()
        console.fail(
            f"a library cannot be loaded: {one_line(error)}; is memory short? `crowdfence doctor` says what "
            "this machine lacks"
        )
        sys.exit(FAILED)
    except MemoryError:
        _reraise_for_debugging()
        console.fail("this machine's memory does not hold what was given; is one of the files too large?")
        sys.exit(FAILED)
    except (OSError, ValueError) as error:
        _reraise_for_debugging()
        console.fail(in_options(one_line(error, whole=True)))
        sys.exit(FAILED)


def _open_closed_streams() -> None:
    """A stream that whoever started this has closed leads nowhere; left closed, what is said would end the
    work, and the first file that is opened would be the stream that libraries write to."""
    for stream in range(3):
        try:
            os.fstat(stream)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # it gets the lowest number that is free, which is this one
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)


def _reraise_for_debugging() -> None:
    if os.environ.get("CROWDFENCE_DEBUG"):
        raise
