"""The interface keeps what its description promises, whatever is sent."""

from pathlib import Path

import pytest
import schemathesis
from hypothesis import HealthCheck, settings
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from crowdfence.service.app import make_app
from support.small_service import asked, message, running, settle, views


@pytest.fixture(scope="module")
def described(tmp_path_factory: pytest.TempPathFactory):
    with running(tmp_path_factory.mktemp("described")) as service, asked(service):
        assert service.live is not None
        for one in views(9):
            service.live.give_view(message(one))
        settle(service)
        app = make_app(service)
        service.hub.start = lambda: None  # type: ignore[method-assign]
        yield schemathesis.openapi.from_asgi("/api/v1/openapi.json", app)


schema = schemathesis.pytest.from_fixture("described")


@schema.parametrize()
@settings(max_examples=6, deadline=None, suppress_health_check=list(HealthCheck))
def test_no_answer_breaks_the_description(case) -> None:
    case.call_and_validate(
        checks=(
            not_a_server_error,
            status_code_conformance,
            content_type_conformance,
            response_schema_conformance,
        )
    )


def test_the_message_of_a_view_is_described(tmp_path: Path) -> None:
    with running(tmp_path) as service, asked(service) as http:
        told = http.get("/api/v1/openapi.json").json()
        view = told["components"]["schemas"]["ViewMessage"]
        assert {"drone", "stamp_ns", "camera", "world_from_camera"} <= set(view["required"])
        assert told["components"]["schemas"].keys() >= {"CameraMessage", "HeatmapMessage"}
        for name in ("/docs", "/redoc"):  # they would load scripts from elsewhere
            assert http.get(name).status_code == 404
