"""The application: routes, page and guard around a service."""

from __future__ import annotations

import json
import logging
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import APIRouter, Depends, FastAPI, WebSocket
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import BaseModel
from starlette.requests import HTTPConnection, Request
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response
from starlette.staticfiles import StaticFiles

from crowdfence._core import __version__
from crowdfence.errors import quoted
from crowdfence.service.guard import Guard, Rate
from crowdfence.service.routes import alerts, base_map, drones, health, ingest, operator, scene, zones
from crowdfence.service.routes.asking import API, cookie_of, known_only, user_or_none
from crowdfence.service.service import Service
from crowdfence.service.store import StoreError
from crowdfence.service.timeline import LostMomentError
from crowdfence.service.zone_set_json import ANY_VERSION

PAGE = Path(__file__).parent / "page"
_LOG = logging.getLogger(__name__)
_NO_PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>crowdfence</title>
<body><h1>crowdfence</h1><p>The service runs. Its map page was not built: <code>make page</code> builds
it.</p> <p>The interface is described in <a
href="/api/v1/openapi.json">/api/v1/openapi.json</a>.</p></body></html>"""
_NO_TOKEN = """<!doctype html><html lang="en"><meta charset="utf-8"><title>crowdfence</title>
<body><h1>crowdfence</h1><p>Open this page once as <code>/?token=YOUR-TOKEN</code>.</p></body></html>"""
_WRONG_TOKEN = """<!doctype html><html lang="en"><meta charset="utf-8"><title>crowdfence</title>
<body><h1>crowdfence</h1><p>The service knows nobody with this token: it is not whole, or was taken
back, or is for another service. Tokens made since the service was started count once it is started
again.</p></body></html>"""


def make_app(service: Service, *, hosts: frozenset[str] = frozenset(), secure: bool = False) -> FastAPI:
    """`hosts`: see `Guard`; `secure`: the cookie goes over TLS only."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        service.hub.start()
        yield

    app = FastAPI(
        title="crowdfence",
        version=__version__,
        description="Crowds seen by a fleet of drones, and no-fly zones. Unseen ground is never free.",
        openapi_url=f"{API}/openapi.json",
        docs_url=None,
        redoc_url=None,
        lifespan=lifespan,
    )
    app.state.service = service
    for module in (scene, base_map, zones, drones, alerts, operator, ingest):
        for router in (module.router, _heads(module.router)):
            app.include_router(router, prefix=API, dependencies=[Depends(known_only)])
    app.include_router(health.router)
    app.include_router(_heads(health.router))

    @app.websocket(f"{API}/stream")
    async def stream(socket: WebSocket) -> None:
        user = user_or_none(socket)
        if user is None:
            await socket.close(code=1008, reason="a token is needed")
            return
        without = socket.query_params.get("without_static")
        if without not in (None, ANY_VERSION):
            await socket.close(
                code=1008, reason=f"without_static is {quoted(without)}; it can be {ANY_VERSION}"
            )
            return
        hello = {"type": "hello", "scene": service.scene_json(user)}
        await service.hub.serve(socket, hello, with_static=without is None)

    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(LostMomentError, _lost)
    app.add_exception_handler(StoreError, _unread)

    @app.api_route("/", methods=["GET", "HEAD"], include_in_schema=False)
    def page(request: Request) -> Response:
        token = request.query_params.get("token")
        if token is not None and service.access.user_of(token) is not None:
            # The address with the token must not stay in the browser's history. As seen from the page, which
            # a proxy may have put under a path of its own.
            answer = RedirectResponse("./", status_code=303)
            answer.set_cookie(
                cookie_of(request),
                token,
                httponly=True,
                samesite="strict",
                secure=secure,
                max_age=30 * 86400,
            )
            return answer
        if token is not None:  # not as whoever this browser was before: a role of somebody else surprises
            return HTMLResponse(_WRONG_TOKEN, status_code=401)
        if user_or_none(request) is None:
            return HTMLResponse(_NO_TOKEN, status_code=401)
        index = PAGE / "index.html"
        return HTMLResponse(index.read_text(encoding="utf-8") if index.exists() else _NO_PAGE)

    _describe(app, ingest.SCHEMAS)
    app.state.parameters = _parameters(app)
    if PAGE.is_dir():
        app.mount("/", StaticFiles(directory=PAGE), name="page")
    app.add_middleware(
        Guard,
        hosts=hosts,
        max_body=int(service.settings.max_body_mb * 1e6),
        requests=Rate(service.settings.requests_per_s),
        views=Rate(service.settings.given_per_s),
        gives=frozenset({f"{API}/views", f"{API}/observations"}),
        on_flood=lambda scope: _flooded(service, HTTPConnection(scope)),
    )
    return app


def _flooded(service: Service, connection: HTTPConnection) -> str:
    """Why the view is refused. An alert too, from whom views would have been taken: that of others would have
    been lost anyhow."""
    user = user_or_none(connection)
    address = connection.client.host if connection.client else "an unknown address"
    who = f"the token {user.name}, at {address}," if user and service.access.needs_token else address
    reason = (
        f"{who} gives more than {service.settings.given_per_s:g} views a second: those beyond are refused "
        "unread, whatever drones they are of, and lost unless they are given again; give fewer of each drone"
    )
    if service.live is not None and user is not None and user.may("give"):
        service.live.flooded(reason)
    return reason


def _invalid(request: Request, error: Exception) -> Response:
    """Where and what, as FastAPI says it, without what was sent: that can be text that no answer can hold,
    with halves of characters (lone surrogates), which are escaped where they are in a name."""
    assert isinstance(error, RequestValidationError)
    problems = [{name: problem[name] for name in ("type", "loc", "msg")} for problem in error.errors()]
    return Response(json.dumps({"detail": problems}), 422, media_type="application/json")


def _lost(request: Request, error: Exception) -> Response:
    return JSONResponse({"detail": str(error)}, 404)


def _unread(request: Request, error: Exception) -> Response:
    _LOG.error("%s", error)
    return JSONResponse({"detail": str(error)}, 503)


def _heads(router: APIRouter) -> APIRouter:
    """HEAD, which proxies and health checks ask with, wherever GET works; the server leaves out the bodies.
    The description of the interface need not say everything twice."""
    heads = APIRouter()
    for route in router.routes:
        if isinstance(route, APIRoute) and "GET" in (route.methods or ()):
            heads.add_api_route(
                route.path,
                route.endpoint,
                methods=["HEAD"],
                response_class=route.response_class,
                include_in_schema=False,
            )
    return heads


def _parameters(app: FastAPI) -> dict[str, set[str]]:
    """The names of the parameters behind the question mark, by path within `API`."""
    return {
        path.removeprefix(API): {
            parameter["name"]
            for operation in operations.values()
            for parameter in operation.get("parameters", ())
            if parameter["in"] == "query"
        }
        for path, operations in app.openapi()["paths"].items()
    }


def _describe(app: FastAPI, messages: Sequence[type[BaseModel]]) -> None:
    """Messages that routes read themselves belong to the description of the interface too."""
    told = app.openapi()
    schemas = told.setdefault("components", {}).setdefault("schemas", {})
    for message in messages:
        schema = message.model_json_schema(ref_template="#/components/schemas/{model}")
        schemas |= schema.pop("$defs", {})
        schemas[message.__name__] = schema
