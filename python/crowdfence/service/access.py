"""Who may do what. Tokens are random; the file holds their hashes."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from crowdfence.atomic_file import write_bytes
from crowdfence.errors import quoted

Role = Literal["viewer", "drone", "operator"]
ROLES: tuple[Role, ...] = get_args(Role)
COOKIE = "crowdfence_token"
_FORMAT = "crowdfence tokens"

MAY: Mapping[Role, frozenset[str]] = {
    "viewer": frozenset({"read"}),
    "drone": frozenset({"read", "give"}),
    "operator": frozenset({"read", "give", "decide"}),
}
"""read: everything that is published; give: views and observations; decide: zones, alerts, the audit log."""


@dataclass(frozen=True, slots=True)
class User:
    """Somebody with a token."""

    name: str
    role: Role
    drones: tuple[str, ...] = ()
    """For role drone: whose views it may give; empty for any."""

    def may(self, what: str) -> bool:
        return what in MAY[self.role]


LOCAL = User("local", "operator")
"""Whoever reaches the loopback address where there are no tokens."""


class TokenFileError(ValueError):
    """A file that holds no tokens; the message names it."""


class Access:
    """Tokens -> users. Without a file everybody is the local operator."""

    def __init__(self, users: Mapping[str, User] | None = None) -> None:
        self._users = users

    @staticmethod
    def of(path: Path | None) -> Access:
        """TokenFileError, OSError."""
        return Access(None if path is None else read_tokens(path))

    @property
    def needs_token(self) -> bool:
        return self._users is not None

    def user_of(self, token: str | None) -> User | None:
        """None for a token that nobody has."""
        if self._users is None:
            return LOCAL
        # Found by the hash of what was sent: how long that takes says nothing about the tokens there are.
        return None if not token else self._users.get(hashed(token))


def hashed(token: str) -> str:
    """256 random bits need no slow hash."""
    return hashlib.sha256(token.encode(errors="replace")).hexdigest()


def read_tokens(path: Path) -> dict[str, User]:
    """Hash -> user. TokenFileError, OSError."""
    try:
        told = json.loads(path.read_bytes())
        if told["format"] != _FORMAT:
            raise ValueError(f"it is {told['format']}")
        users = {}
        for entry in told["tokens"]:
            if entry["role"] not in ROLES:
                raise ValueError(f"role {entry['role']!r} is none of {', '.join(ROLES)}")
            users[entry["sha256"]] = User(entry["name"], entry["role"], tuple(entry.get("drones", ())))
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise TokenFileError(f"{path} holds no tokens: {type(error).__name__} {error}") from error
    return users


def add_token(path: Path, name: str, role: Role, drones: tuple[str, ...] = ()) -> str:
    """Make a token and write its hash into the file, which is made if it is missing; the token, which nobody
    can read again. ValueError for a name that has one, TokenFileError, OSError."""
    users = read_tokens(path) if path.exists() else {}
    if any(user.name == name for user in users.values()):
        raise ValueError(f"{name} has a token in {path}; remove it first")
    if not name or len(name) > 64:
        raise ValueError(f"the name {quoted(name)} must have 1 to 64 characters")
    if drones and role != "drone":
        raise ValueError(f"only tokens of role drone are limited to drones, not those of role {role}")
    token = secrets.token_urlsafe(32)
    _write(path, {**users, hashed(token): User(name, role, drones)})
    return token


def remove_token(path: Path, name: str) -> None:
    """ValueError for a name that has none, TokenFileError, OSError."""
    users = read_tokens(path)
    kept = {digest: user for digest, user in users.items() if user.name != name}
    if len(kept) == len(users):
        raise ValueError(f"{name} has no token in {path}")
    _write(path, kept)


def _write(path: Path, users: Mapping[str, User]) -> None:
    tokens: list[dict[str, Any]] = [
        {"name": user.name, "role": user.role, "sha256": digest, "drones": list(user.drones)}
        for digest, user in users.items()
    ]
    write_bytes(path, (json.dumps({"format": _FORMAT, "tokens": tokens}, indent=1) + "\n").encode())
    os.chmod(path, 0o600)
