"""HTTPS and WSS from the command line to the Python client, with a certificate of our own."""

import json
import shutil
import ssl
import subprocess
from collections.abc import Iterator
from pathlib import Path
from time import sleep
from typing import NamedTuple

import httpx
import pytest

from crowdfence import Client
from crowdfence.service.access import add_token
from crowdfence.service.client import ServiceError
from crowdfence.service.server import Address
from support.served import Served, serving
from support.small_service import views


class Pair(NamedTuple):
    certificate: Path
    key: Path


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Pair:
    """A certificate for 127.0.0.1 that nobody else signed."""
    if shutil.which("openssl") is None:
        pytest.skip("there is no openssl command to make a certificate with")
    return make_pair(tmp_path_factory.mktemp("tls"))


def make_pair(folder: Path) -> Pair:
    made = Pair(folder / "certificate.pem", folder / "key.pem")
    words = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    words += ["-days", "2", "-subj", "/CN=field", "-addext", "subjectAltName=IP:127.0.0.1"]
    words += ["-out", str(made.certificate), "-keyout", str(made.key)]
    subprocess.run(words, check=True, capture_output=True)
    made.key.chmod(0o600)
    return made


@pytest.fixture(scope="module")
def served(pair: Pair, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Served, str]]:
    """A service with tokens over TLS, and the token of an operator."""
    folder = tmp_path_factory.mktemp("served")
    token = add_token(folder / "tokens.json", "ana", "operator")
    words = ["--tokens", folder / "tokens.json", "--json-logs", "--min-area-m2", 3]
    words += ["--tls-certificate", pair.certificate, "--tls-key", pair.key]
    with serving(folder, *words) as started:
        yield started, token


def test_views_zones_and_the_stream_go_over_tls(served: tuple[Served, str], pair: Pair) -> None:
    started, token = served
    assert started.url.startswith("https://127.0.0.1:")
    with Client(started.url, token=token, ca=pair.certificate) as client:
        places = [client.give(view) for view in views(8)]
        assert len(set(places)) == 24
        # Views are acknowledged before they are in the map.
        assert any(client.zones()["zones"] or sleep(0.1) for _ in range(600))
        told = client.stream()
        hello = next(told)
        assert (hello["type"], hello["scene"]["user"]) == ("hello", "ana")
        step = next(message for message in told if message["type"] == "step")
        assert step["zone_count"] >= 1


def test_who_does_not_know_the_certificate_sends_nothing(served: tuple[Served, str]) -> None:
    """No token reaches a service that may be somebody else."""
    started, token = served
    with Client(started.url, token=token) as client:
        with pytest.raises(httpx.ConnectError, match="CERTIFICATE_VERIFY_FAILED"):
            client.zones()
        with pytest.raises(OSError, match="CERTIFICATE_VERIFY_FAILED"):
            next(client.stream())


def test_clear_text_and_no_token_get_no_answer(served: tuple[Served, str], pair: Pair) -> None:
    started, token = served
    clear = started.url.replace("https", "http")
    with Client(clear, token=token) as client, pytest.raises(httpx.TransportError):
        client.zones()
    with Client(started.url, ca=pair.certificate) as client, pytest.raises(ServiceError, match="401"):
        client.zones()


def test_who_asks_for_the_head_gets_it_without_a_body(served: tuple[Served, str], pair: Pair) -> None:
    started, token = served
    with httpx.Client(
        verify=ssl.create_default_context(cafile=str(pair.certificate)),
        headers={"Authorization": f"Bearer {token}"},
    ) as http:
        for path in ("/healthz", "/api/v1/scene", "/api/v1/export?format=geojson"):
            for _ in range(2):  # a body would stand before the second answer on the same connection
                head = http.head(started.url.rstrip("/") + path)
                assert head.status_code == 200 and not head.content
                assert int(head.headers["content-length"]) > 0


def test_the_log_is_a_json_object_a_line(served: tuple[Served, str]) -> None:
    started, _ = served
    lines = [json.loads(line) for line in started.log.read_text().splitlines()]
    assert lines and all({"time", "level", "logger", "message"} <= line.keys() for line in lines)


def test_a_key_that_anybody_can_read_is_refused(pair: Pair, tmp_path: Path) -> None:
    key = tmp_path / "key.pem"
    key.write_bytes(pair.key.read_bytes())
    for mode, fine in ((0o644, False), (0o604, False), (0o640, True), (0o600, True)):
        key.chmod(mode)
        address = Address(certificate=pair.certificate, key=key)
        if fine:
            address.check(has_tokens=True)
            continue
        with pytest.raises(ValueError, match="chmod 600"):
            address.check(has_tokens=True)


def test_a_key_of_another_certificate_is_refused_before_the_start(pair: Pair, tmp_path: Path) -> None:
    other = make_pair(tmp_path)
    with pytest.raises(ValueError, match="no pair"):
        Address(certificate=pair.certificate, key=other.key).check(has_tokens=True)
    with pytest.raises(FileNotFoundError):
        Address(certificate=tmp_path / "none.pem", key=other.key).check(has_tokens=True)


def test_a_key_with_a_pass_phrase_asks_no_terminal(pair: Pair, tmp_path: Path) -> None:
    locked = tmp_path / "locked.pem"
    words = ["openssl", "pkey", "-in", str(pair.key), "-aes256", "-passout", "pass:secret"]
    subprocess.run([*words, "-out", str(locked)], check=True, capture_output=True)
    locked.chmod(0o600)
    with pytest.raises(ValueError, match="pass phrase"):
        Address(certificate=pair.certificate, key=locked).check(has_tokens=True)
