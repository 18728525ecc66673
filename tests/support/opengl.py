"""Marks the tests that render: they are skipped, with the reason, where no OpenGL context can be made."""

import pytest

from crowdfence.simulation.rendering.opengl_context import NoOpenGL, open_context


def _missing() -> str:
    try:
        open_context().release()
    except NoOpenGL as error:
        return str(error)
    return ""


_REASON = _missing()
needs_opengl = pytest.mark.skipif(bool(_REASON), reason=_REASON or "OpenGL is there")
