"""Who may do what, and what the network is refused."""

import gzip
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect
from typer.testing import CliRunner

import crowdfence
from crowdfence.cli.app import app as command_line
from crowdfence.maps import MapError
from crowdfence.service.access import Access, TokenFileError, add_token, read_tokens, remove_token
from crowdfence.service.app import make_app
from crowdfence.service.clock import Clock
from crowdfence.service.guard import Rate
from crowdfence.service.server import LOOPBACK_NAMES, Address, OpenToAll
from crowdfence.service.service import Service
from crowdfence.service.watch import Watch
from support.small_service import SETTINGS, START_NS, asked, message, running, view, views

ROLES = ("nobody", "viewer", "drone", "operator")
DRONE = "/drones/uav1"
READING = ["/scene", "/terrain", "/terrain/colour", "/belief", "/zones", "/zones/Z1/history", "/timeline"]
READING += [
    "/export",
    "/drones",
    f"{DRONE}/picture",
    f"{DRONE}/heatmap",
    "/alerts",
    "/me",
    "/base-map",
    "/base-map/picture",
]
BECAUSE = {"reason": "because"}
DRAWN = {"polygon": [[1, 1], [4, 1], [4, 4]], "reason": "ambulance"}
# What each role is answered: 401 nobody, 403 not allowed; anything else got through to the route.
DECIDING = [
    ("POST", "/zones", DRAWN),
    ("POST", "/zones/Z9/lock", BECAUSE),
    ("POST", "/zones/Z9/unlock", BECAUSE),
    ("POST", "/zones/Z9/dismiss", BECAUSE),
    ("POST", "/drones/uav1/leave-out", BECAUSE),
    ("POST", "/drones/uav1/take-in", BECAUSE),
    ("POST", "/alerts/A99/acknowledge", {}),
    ("GET", "/audit", None),
]


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Service, dict[str, str], TestClient]]:
    """A service with tokens, the token of every role, and its face."""
    folder = tmp_path_factory.mktemp("guarded")
    tokens = {role: add_token(folder / "tokens.json", f"my {role}", role) for role in ROLES[1:]}  # type: ignore[arg-type]
    tokens["uav1 only"] = add_token(folder / "tokens.json", "uav1", "drone", ("uav1",))
    access = Access.of(folder / "tokens.json")
    with running(folder / "data", access=access) as service, asked(service) as http:
        yield service, tokens, http


def bearer(tokens: dict[str, str], role: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {tokens.get(role, 'guessed')}"}


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("path", READING)
def test_who_has_a_token_reads_and_nobody_else(guarded, path: str, role: str) -> None:
    _, tokens, http = guarded
    code = http.get(f"/api/v1{path}", headers=bearer(tokens, role)).status_code
    assert code == 401 if role == "nobody" else code in (200, 404, 409, 422)


@pytest.mark.parametrize("role", ["nobody", "viewer", "operator"])
@pytest.mark.parametrize("path", ["/", "/metrics", *(f"/api/v1{path}" for path in [*READING, "/audit"])])
def test_proxies_and_health_checks_that_ask_for_the_head_are_answered_as_get_is(
    guarded, path: str, role: str
) -> None:
    """404 or 405 looked like a service that is down, or an address that is wrong."""
    _, tokens, http = guarded
    head, whole = (ask(path, headers=bearer(tokens, role)) for ask in (http.head, http.get))
    assert head.status_code == whole.status_code
    assert head.headers["content-type"] == whole.headers["content-type"]


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize(("method", "path", "body"), DECIDING)
def test_operators_decide_and_nobody_else(guarded, method: str, path: str, body, role: str) -> None:
    _, tokens, http = guarded
    code = http.request(method, f"/api/v1{path}", json=body, headers=bearer(tokens, role)).status_code
    assert code == {"nobody": 401, "viewer": 403, "drone": 403}.get(role, code)
    if role == "operator":
        assert code in (200, 201, 204, 404, 409)


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("path", ["/views", "/observations"])
def test_drones_and_operators_give_views_and_nobody_else(guarded, path: str, role: str) -> None:
    _, tokens, http = guarded
    code = http.post(f"/api/v1{path}", content=b"", headers=bearer(tokens, role)).status_code
    assert code == {"nobody": 401, "viewer": 403}.get(role, 422)


def test_a_drones_token_gives_its_own_views_only(guarded) -> None:
    _, tokens, http = guarded
    mine = http.post("/api/v1/views", content=message(view("uav1", 0)), headers=bearer(tokens, "uav1 only"))
    other = http.post("/api/v1/views", content=message(view("uav2", 0)), headers=bearer(tokens, "uav1 only"))
    assert (mine.status_code, other.status_code) == (202, 403)


def test_every_route_is_in_one_of_the_lists_above(guarded) -> None:
    """A new route is public until somebody says who may use it: say it here."""
    service, _, http = guarded

    paths = {path.removeprefix("/api/v1") for path in http.app.openapi()["paths"]}  # type: ignore[attr-defined]
    listed = {*READING, "/views", "/observations", "/healthz", "/metrics"}
    listed |= {path.replace("Z9", "Z1") for _, path, _ in DECIDING}
    assert {path.format(zone="Z1", drone="uav1", alert="A99") for path in paths} == listed
    assert http.get("/metrics").status_code == 401
    # Whatever watches addresses asks for the head alone, as a rule.
    assert [ask("/healthz").status_code for ask in (http.get, http.head)] == [200, 200]
    assert service.access.needs_token


def test_the_stream_needs_a_token(guarded) -> None:
    _, tokens, http = guarded
    with pytest.raises(WebSocketDisconnect), http.websocket_connect("/api/v1/stream"):
        pass
    with http.websocket_connect("/api/v1/stream", headers=bearer(tokens, "viewer")) as socket:
        hello = socket.receive_json()
    assert (hello["type"], hello["scene"]["user"], hello["scene"]["role"]) == ("hello", "my viewer", "viewer")


def test_the_page_turns_a_token_into_a_cookie_once(guarded) -> None:
    service, tokens, _ = guarded
    with asked(service, secure=True) as http:
        assert http.get("/").status_code == 401
        guessed = http.get("/?token=guessed")
        assert guessed.status_code == 401 and "knows nobody with this token" in guessed.text
        answer = http.get(f"/?token={tokens['viewer']}", follow_redirects=False)
        assert (answer.status_code, answer.headers["location"]) == (303, "./")
        cookie = answer.headers["set-cookie"].lower()
        assert all(word in cookie for word in ("httponly", "samesite=strict", "secure"))
        named = {"Cookie": f"crowdfence_token_80={tokens['viewer']}"}
        assert http.get("/", headers=named).status_code == 200
        assert http.get("/api/v1/me", headers=named).json() == {"user": "my viewer", "role": "viewer"}
        # With a token that nobody has it is not the page of whoever the browser was before.
        assert http.get("/?token=guessed", headers=named).status_code == 401


def test_a_browser_can_be_signed_in_to_two_services_of_one_machine(guarded, tmp_path: Path) -> None:
    """Browsers keep cookies by host, whatever the port: they send those of both to both."""
    service, tokens, _ = guarded
    other = add_token(tmp_path / "tokens.json", "ana", "operator")
    with running(tmp_path / "data", access=Access.of(tmp_path / "tokens.json")) as second:
        jar: dict[str, str] = {}
        faces = []
        for port, one, token in ((8080, service, tokens["viewer"]), (8081, second, other)):
            face = TestClient(make_app(one), base_url=f"http://localhost:{port}")
            jar.update(face.get(f"/?token={token}", follow_redirects=False).cookies)
            faces.append(face)
        sent = {"Cookie": "; ".join(f"{name}={value}" for name, value in jar.items())}
        users = [
            TestClient(face.app, base_url=face.base_url).get("/api/v1/me", headers=sent).json()
            for face in faces
        ]
        assert users == [{"user": "my viewer", "role": "viewer"}, {"user": "ana", "role": "operator"}]


def test_the_file_of_tokens_holds_no_token(tmp_path: Path) -> None:
    path = tmp_path / "tokens.json"
    token = add_token(path, "ana", "operator")
    assert token not in path.read_text() and len(token) >= 43  # 256 bits in base 64
    assert path.stat().st_mode & 0o077 == 0
    user = Access.of(path).user_of(token)
    assert user is not None and (user.name, user.role) == ("ana", "operator")
    with pytest.raises(ValueError, match="has a token"):
        add_token(path, "ana", "viewer")
    remove_token(path, "ana")
    assert Access.of(path).user_of(token) is None
    with pytest.raises(ValueError, match="has no token"):
        remove_token(path, "ana")
    path.write_text(json.dumps({"format": "crowdfence tokens", "tokens": [{"role": "king", "name": "k"}]}))
    with pytest.raises(TokenFileError, match="king"):
        read_tokens(path)


def test_tokens_are_made_on_the_command_line(tmp_path: Path) -> None:
    tokens = ["--tokens", str(tmp_path / "t.json")]
    made = CliRunner().invoke(
        command_line, ["token", "add", "uav1", "--role", "drone", "--drone", "uav1", *tokens]
    )
    assert made.exit_code == 0
    user = Access.of(tmp_path / "t.json").user_of(made.stdout.strip())
    assert user is not None and (user.role, user.drones) == ("drone", ("uav1",))
    shown = CliRunner().invoke(command_line, ["token", "list", *tokens])
    assert shown.stdout == "uav1: drone of uav1\n"
    assert CliRunner().invoke(command_line, ["token", "remove", "uav1", *tokens]).exit_code == 0
    assert CliRunner().invoke(command_line, ["token", "list", *tokens]).stdout == ""


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.4", "drone-server"])
def test_other_machines_reach_no_service_without_tokens(host: str) -> None:
    with pytest.raises(OpenToAll, match="token add"):
        Address(host).check(has_tokens=False)
    Address(host).check(has_tokens=True)
    finished = CliRunner().invoke(command_line, ["serve", "--terrain", "dem.tif", "--host", host])
    assert isinstance(finished.exception, OpenToAll)


def test_live_views_on_a_map_of_earth_need_to_say_where_they_are(tmp_path: Path) -> None:
    """The middle of the map taken for the origin of the poses would put every zone somewhere else."""
    map_path = Path(crowdfence.__file__).parent / "demo_data" / "race.bt"
    words = ["serve", "--terrain", str(map_path), "--data", str(tmp_path / "data")]
    refused = CliRunner().invoke(command_line, words).exception
    assert isinstance(refused, MapError) and "--origin" in str(refused) and "--assume-local" in str(refused)
    both = CliRunner().invoke(command_line, [*words, "--assume-local", "--origin", "46.5,8,1200"]).exception
    assert isinstance(both, MapError) and "contradicts" in str(both)
    assert not (tmp_path / "data").exists()


def test_loopback_needs_no_tokens_and_tls_needs_both_files() -> None:
    for host in ("127.0.0.1", "::1", "localhost"):
        Address(host).check(has_tokens=False)
    with pytest.raises(ValueError, match="tls-key"):
        Address(certificate=Path("c.pem")).check(has_tokens=True)


def test_pages_of_other_sites_cannot_use_the_loopback_service(tmp_path: Path) -> None:
    """A browser that visits a hostile page can be made to send requests to this machine."""
    with running(tmp_path) as service, asked(service, hosts=LOOPBACK_NAMES) as http:
        assert http.get("/api/v1/me").json() == {"user": "local", "role": "operator"}
        rebound = http.get("/api/v1/me", headers={"Host": "evil.example"})
        assert rebound.status_code == 421
        foreign = http.post("/api/v1/zones", json=DRAWN, headers={"Origin": "https://evil.example"})
        assert foreign.status_code == 403
        for none in ("http://[::1", "null", ""):
            assert http.post("/api/v1/zones", json=DRAWN, headers={"Origin": none}).status_code == 403
        own = http.post("/api/v1/zones", json=DRAWN, headers={"Origin": "http://localhost"})
        assert own.status_code == 201
        with (
            pytest.raises(WebSocketDisconnect),
            http.websocket_connect("/api/v1/stream", headers={"Origin": "https://evil.example"}),
        ):
            pass


def test_every_answer_forbids_what_comes_from_elsewhere(tmp_path: Path) -> None:
    with running(tmp_path) as service, asked(service) as http:
        for path in ("/", "/api/v1/zones", "/api/v1/none", "/nothing.js"):
            answer = http.get(path)
            policy = answer.headers["content-security-policy"]
            assert policy.startswith("default-src 'self'") and "http" not in policy
            assert answer.headers["x-content-type-options"] == "nosniff"
        page = http.get("/").text
        assert "http://" not in page and "https://" not in page


def test_bodies_and_requests_have_limits(tmp_path: Path) -> None:
    small = replace(SETTINGS, max_body_mb=0.001, requests_per_s=3.0)
    with running(tmp_path, settings=small) as service, asked(service) as http:
        assert http.post("/api/v1/views", content=b"x" * 1001).status_code == 413
        cut = http.post("/api/v1/views", content=iter([b"x" * 600, b"x" * 600]))
        assert cut.status_code == 413
        codes = [http.get("/healthz").status_code for _ in range(12)]
        assert 429 in codes


def test_a_body_that_is_compressed_is_refused_by_that_name(tmp_path: Path) -> None:
    """It was no JSON, which whoever gave it looked for in what he had written."""
    (one,) = views(1, ("uav1",))
    with running(tmp_path) as service, asked(service) as http:
        packed = http.post(
            "/api/v1/views", content=gzip.compress(message(one)), headers={"content-encoding": "gzip"}
        )
        assert packed.status_code == 415 and "without Content-Encoding" in packed.json()["detail"]
        assert not service.alerts.all()
        plain = http.post("/api/v1/views", content=message(one), headers={"content-encoding": "identity"})
        assert plain.status_code == 202


def test_a_body_that_is_no_view_is_small(guarded) -> None:
    """Four of 16 MB at once took 1.8 GB, and no token was needed for them."""
    _, tokens, http = guarded
    corners = [[-99_999.123456789012 + k, -99_999.123456789012 - k * k / 100] for k in range(1999)]
    drawn = json.dumps({"polygon": corners, "reason": "x" * 500}).encode()
    headers = {**bearer(tokens, "operator"), "content-type": "application/json"}
    assert http.post("/api/v1/zones", content=drawn, headers=headers).status_code == 201
    large = b'{"polygon": [' + b",".join([b"{}"] * 100_000) + b"]}"
    for body in (large, iter([large[:200_000], large[200_000:]])):
        assert http.post("/api/v1/zones", content=body).status_code in (400, 413)
    assert http.post("/api/v1/views", content=large, headers=headers).status_code == 422  # it is read


def test_a_page_and_the_drones_behind_one_address_do_not_stop_each_other(tmp_path: Path) -> None:
    """Twice as many at once as a second: six requests of the page, and ten views."""
    tight = replace(SETTINGS, requests_per_s=3.0, given_per_s=5.0)
    with running(tmp_path, settings=tight) as service, asked(service) as http:
        codes = [http.get("/api/v1/me").status_code for _ in range(12)]
        assert 429 in codes
        given = [http.post("/api/v1/views", content=message(one)) for one in views(4)]
        assert [answer.status_code for answer in given[:10]] == [202] * 10


def test_views_that_the_limit_refuses_are_counted_and_told(tmp_path: Path) -> None:
    """What nobody read may have shown crowd."""
    now_ns = START_NS
    clock = Clock("system", system=lambda: now_ns, steady=lambda: now_ns)
    tight = replace(SETTINGS, clock="system", given_per_s=0.5)
    with running(tmp_path, settings=tight, clock=clock) as service, asked(service) as http:
        lost = [http.post("/api/v1/views", content=message(one)) for one in views(2)]
        refused = [answer for answer in lost if answer.status_code == 429]
        assert refused
        assert "more than 0.5 views a second" in refused[0].json()["detail"]
        told = [one for one in service.alerts.all() if one.kind == "refused_views"]
        assert [(one.level, one.cleared_ns) for one in told] == [("warning", None)]
        assert "testclient" in told[0].text and "0.5 views a second" in told[0].text
        assert service.live is not None and service.live.heard.refused.total() == len(refused)
        watch = Watch(service)
        watch.look()
        assert service.alerts.active("refused_views", told[0].drone) is not None
        now_ns += 11_000_000_000
        watch.look()
        assert service.alerts.active("refused_views", told[0].drone) is None


def test_who_may_give_nothing_raises_no_alert_of_lost_views(guarded, monkeypatch) -> None:
    service, tokens, _ = guarded
    monkeypatch.setattr(service, "settings", replace(SETTINGS, given_per_s=0.1))
    assert service.live is not None
    before = service.live.heard.refused.total(), [one.id for one in service.alerts.all()]
    with asked(service) as http:
        for role in ("nobody", "viewer"):
            answer = http.post("/api/v1/views", content=b"", headers=bearer(tokens, role))
            assert answer.status_code == 429
        after = service.live.heard.refused.total(), [one.id for one in service.alerts.all()]
        assert after == before
        answer = http.post("/api/v1/views", content=b"", headers=bearer(tokens, "uav1 only"))
        assert answer.status_code == 429 and "the token uav1, at testclient" in answer.json()["detail"]
        assert service.live.heard.refused.total() == before[0] + 1


def test_a_rate_is_one_on_average_and_two_at_once() -> None:
    now_s = 0.0
    rate = Rate(2.0, lambda: now_s)
    assert [rate.wait_s("a") for _ in range(5)] == [0.0, 0.0, 0.0, 0.0, 0.5]
    assert rate.wait_s("b") == 0.0
    now_s = 0.5
    assert rate.wait_s("a") == 0.0 and rate.wait_s("a") > 0.0


def test_the_audit_log_says_who_did_what(guarded) -> None:
    service, tokens, http = guarded
    assert service.live is not None
    for one in views(12):
        service.live.intake.give_view(message(one))
    service.live.applying.settled(20.0)
    headers = bearer(tokens, "operator")
    for action in ("lock", "unlock", "dismiss"):
        answer = http.post(f"/api/v1/zones/Z1/{action}", json={"reason": f"to {action}"}, headers=headers)
        assert answer.status_code == 200, answer.text
    entries = http.get("/api/v1/audit", headers=headers).json()["entries"][:3]
    assert [(one["user"], one["role"], one["action"], one["zone"], one["reason"]) for one in entries] == [
        ("my operator", "operator", action, "Z1", f"to {action}") for action in ("dismiss", "unlock", "lock")
    ]
    assert int(entries[0]["stamp_ns"]) > START_NS
    for body in ({}, {"reason": ""}, {"reason": "   "}, {"reason": "x" * 501}, {"reason": "fine", "more": 1}):
        refused = http.post("/api/v1/zones/Z1/lock", json=body, headers=headers)
        assert refused.status_code == 422, body
