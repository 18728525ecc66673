"""The interface keeps what its description promises, whatever is sent."""

import logging
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import schemathesis
from hypothesis import HealthCheck, given, settings
from hypothesis.errors import Unsatisfiable
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from crowdfence.service.app import make_app
from support.small_service import asked, message, running, settle, views

CHECKS = (not_a_server_error, status_code_conformance, content_type_conformance, response_schema_conformance)


@pytest.fixture(autouse=True)
def without_tracebacks() -> Iterator[None]:
    """In the threads of the service, whose logging formats them by `ast.parse`: CPython 3.11 keeps one depth
    for all threads that parse, and Hypothesis, which parses here too, has Python code run in between by a
    callback of the garbage collector ("AST constructor recursion depth mismatch")."""
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(logging.NOTSET)


def test_no_answer_breaks_the_description(tmp_path: Path) -> None:
    """Every operation gets messages that follow its description, and some that do not."""
    with running(tmp_path) as service:
        assert service.live is not None
        for one in views(9):
            service.live.intake.give_view(message(one))
        settle(service)
        described = schemathesis.openapi.from_asgi("/api/v1/openapi.json", make_app(service))
        tried = 0
        for found in described.get_all_operations():
            operation = found.ok()
            for mode in GenerationMode:

                @settings(max_examples=3, database=None, suppress_health_check=list(HealthCheck))
                @given(operation.as_strategy(generation_mode=mode))
                def keeps_its_promise(case) -> None:
                    case.call_and_validate(checks=CHECKS)

                with suppress(Unsatisfiable):  # nothing about it can be wrong
                    keeps_its_promise()
                    tried += 1
        assert tried > 25


def test_ids_with_line_breaks_are_no_places_and_that_is_described(tmp_path: Path) -> None:
    """Ids and names may have slashes, so each is the rest of a path up to its last part, and a line of it."""
    with running(tmp_path) as service, asked(service) as http:
        paths = http.get("/api/v1/openapi.json").json()["paths"]
        described = {path: one for path, one in paths.items() if "{zone}" in path or "{drone}" in path}
        assert len(described) == 8
        for path, operations in described.items():
            ((method, operation),) = operations.items()
            place = path.replace("{zone}", "a%0Ab").replace("{drone}", "a%0Ab")
            answer = http.request(method, place, json={"name": "ops", "reason": "drill"})
            assert answer.status_code == 404 and "404" in operation["responses"], path


def test_the_message_of_a_view_is_described(tmp_path: Path) -> None:
    with running(tmp_path) as service, asked(service) as http:
        told = http.get("/api/v1/openapi.json").json()
        view = told["components"]["schemas"]["ViewMessage"]
        assert set(view["required"]) == {"drone", "stamp_ns", "camera"}
        assert {"world_from_camera", "heatmap", "image"} <= view["properties"].keys()
        assert told["components"]["schemas"].keys() >= {"CameraMessage", "HeatmapMessage"}
        for name in ("/docs", "/redoc"):  # they would load scripts from elsewhere
            assert http.get(name).status_code == 404
