"""An OpenGL context without a window: EGL, on a GPU's driver or on Mesa's software rasteriser."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import moderngl

INSTALL_LINE = "apt-get install libegl1 libgl1-mesa-dri"
_GL_VERSION = 430  # for multi-draw indirect


class NoOpenGL(RuntimeError):
    """This machine cannot render: a library, the driver or the Python package is missing."""


def open_context() -> moderngl.Context:
    """A new stand-alone context. NoOpenGL says what is missing and how to install it."""
    try:
        import moderngl
    except ImportError as error:
        raise NoOpenGL(
            'rendering needs the Python package moderngl: pip install "crowdfence[sim]"'
        ) from error
    try:
        settings: Any = {"backend": "egl"}
        return moderngl.create_context(standalone=True, require=_GL_VERSION, **settings)
    except Exception as error:  # the binding raises plain Exception for everything that EGL refuses
        raise NoOpenGL(
            f"no OpenGL {_GL_VERSION / 100:.1f} through EGL ({error}); on Debian or Ubuntu: {INSTALL_LINE}. "
            "Labels and depth can still be made without it (raycast_labels)"
        ) from error
