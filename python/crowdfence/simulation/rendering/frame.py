"""What one rendered image holds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class RenderedFrame:
    """One image of the scene; row 0 is the top row, labels and depth belong to the pixels' centre rays."""

    rgb: NDArray[np.uint8] | None
    """[H, W, 3] sRGB; None when the frame was made without OpenGL."""
    class_id: NDArray[np.uint8]
    """[H, W] `SceneClass`."""
    instance_id: NDArray[np.uint16]
    """[H, W] 0 = no one, 1..P people, P + 1.. cyclists."""
    depth_m: NDArray[np.float32]
    """[H, W] distance along the optical axis, inf where there is sky."""
