"""Who asks, and for when."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import Depends, HTTPException, Query
from starlette.requests import HTTPConnection, Request

from crowdfence.errors import quoted
from crowdfence.iso_time import iso_utc
from crowdfence.service.access import COOKIE, User
from crowdfence.service.service import Service
from crowdfence.service.stamps import stamp_of
from crowdfence.sources.stamp_unit import THIS_CENTURY_S, unit_hint

ERRORS: dict[int | str, dict[str, Any]] = {
    400: {"description": "the body cannot be read"},
    401: {"description": "no token, or one that nobody has"},
    403: {"description": "the role may not do this"},
    422: {"description": "something is out of its bounds"},
    429: {"description": "too many requests; Retry-After says when to come again"},
}
API = "/api/v1"
_LEAST_NS = THIS_CENTURY_S.start * 1_000_000_000


def service_of(connection: HTTPConnection) -> Service:
    service: Service = connection.app.state.service
    return service


def user_of(connection: HTTPConnection) -> User:
    """Whoever the token belongs to. 401 for nobody."""
    user = user_or_none(connection)
    if user is None:
        raise HTTPException(
            401, "a token is needed: Authorization: Bearer TOKEN", {"WWW-Authenticate": "Bearer"}
        )
    return user


def cookie_of(connection: HTTPConnection) -> str:
    """The name of the cookie with the token. With the port, because browsers send cookies to all ports of a
    machine: whoever signed in to a second service there would be nobody to the first."""
    server = connection.scope.get("server") or ("", None)
    return COOKIE if server[1] is None else f"{COOKIE}_{server[1]}"


def user_or_none(connection: HTTPConnection) -> User | None:
    scheme, _, token = connection.headers.get("authorization", "").partition(" ")
    if scheme.lower() != "bearer":
        token = connection.cookies.get(cookie_of(connection), "")
    return service_of(connection).access.user_of(token.strip())


def _who_may(what: str) -> Any:
    def check(user: Annotated[User, Depends(user_of)]) -> User:
        if not user.may(what):
            raise HTTPException(403, f"role {user.role} may not {what}")
        return user

    return Depends(check)


TheService = Annotated[Service, Depends(service_of)]


def at_ns(
    service: TheService,
    at: Annotated[
        str | None,
        Query(description="Nanoseconds since 1970 as digits; left out: the newest.", max_length=20),
    ] = None,
) -> int | None:
    """422 for what is no stamp, or one in another unit: before all that is known nothing is closed; and for
    one that is still to come: what is open now, as a dismissed zone is, may be closed then."""
    try:
        asked_ns = stamp_of(at)
    except ValueError as error:
        raise HTTPException(422, str(error)) from error
    if asked_ns is None:
        return None
    now_ns, newest = service.now_ns(), service.mission.newest
    # The clock of a simulation passes through all numbers.
    if asked_ns < _LEAST_NS <= now_ns:
        raise HTTPException(422, f"at is {asked_ns} ns since 1970, before 2001{unit_hint(asked_ns)}")
    latest_ns = max(now_ns, 0 if newest is None else newest.stamp_ns)
    ahead_s = (asked_ns - latest_ns) / 1e9
    # A clock that only views move has not begun before the first of them.
    if now_ns > 0 and ahead_s > service.settings.max_ahead_s:
        raise HTTPException(
            422,
            f"at lies {ahead_s:.1f} s after now, {iso_utc(latest_ns)}: nobody knows what is closed then; "
            "leave at out for what is closed now",
        )
    return asked_ns


def known_only(request: Request) -> None:
    """422 for a parameter that there is not: a misspelled `at` would be left out, and now told for then."""
    known = request.app.state.parameters[request.scope["route"].path_format.removeprefix(API)]
    for name in request.query_params:
        if name not in known:
            there = f"there are: {', '.join(sorted(known))}" if known else "there are none here"
            raise HTTPException(422, f"there is no parameter {quoted(name)}; {there}")


def kept(
    service: TheService,
    run: Annotated[
        str | None, Query(description="Of the scene: then a browser may keep the answer.", max_length=20)
    ] = None,
) -> dict[str, str]:
    """Headers of what stays the same while the service runs. Another one at the same address may have another
    ground."""
    known = run == service.mission.run
    return {"cache-control": "private, max-age=3600" if known else "private, no-cache"}


Reader = Annotated[User, _who_may("read")]
Giver = Annotated[User, _who_may("give")]
Decider = Annotated[User, _who_may("decide")]
AtNs = Annotated["int | None", Depends(at_ns)]
Kept = Annotated["dict[str, str]", Depends(kept)]
