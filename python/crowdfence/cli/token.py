"""`crowdfence token`: who may use a service that other machines reach."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from crowdfence.cli import console, options

app = typer.Typer(help="Who may use a service that other machines reach.", no_args_is_help=True)
Tokens = Annotated[Path, typer.Option("--tokens", help="File of hashes; made if it is missing.")]
DEFAULT_TOKENS = Path("tokens.json")


class RoleName(str, Enum):
    """What a token is for."""

    viewer = "viewer"
    drone = "drone"
    operator = "operator"


@app.command("add")
def add(
    name: Annotated[str, typer.Argument(help="Whose it is: a person, a drone, a program.")],
    role: Annotated[
        RoleName, typer.Option("--role", help="viewer reads, drone gives views, operator decides.")
    ],
    tokens: Tokens = DEFAULT_TOKENS,
    drone: Annotated[
        list[str] | None,
        typer.Option("--drone", help="For role drone: whose views it gives; may be repeated. Default: any."),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Make a token and print it. The file keeps its hash only: nobody can read the token again."""
    from crowdfence.service.access import add_token

    token = add_token(tokens, name, role.value, tuple(drone or ()))
    if as_json:
        console.print_json({"name": name, "role": role.value, "token": token})
    else:
        console.stdout().print(token, soft_wrap=True)


@app.command("list")
def show(tokens: Tokens = DEFAULT_TOKENS, as_json: options.Json = False) -> None:
    """Names and roles."""
    from crowdfence.service.access import read_tokens

    users = sorted(read_tokens(tokens).values(), key=lambda user: user.name)
    if as_json:
        console.print_json(
            [{"name": user.name, "role": user.role, "drones": list(user.drones)} for user in users]
        )
        return
    for user in users:
        of = f" of {', '.join(user.drones)}" if user.drones else ""
        console.stdout().print(console.escaped(f"{user.name}: {user.role}{of}"), soft_wrap=True)


@app.command("remove")
def remove(
    name: Annotated[str, typer.Argument(help="Whose token no longer counts.")],
    tokens: Tokens = DEFAULT_TOKENS,
    as_json: options.Json = False,
) -> None:
    """Forget a token; a running service forgets it when it starts again."""
    from crowdfence.service.access import remove_token

    remove_token(tokens, name)
    if as_json:
        console.print_json({"removed": name})
