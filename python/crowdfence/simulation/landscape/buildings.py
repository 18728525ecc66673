"""Houses: boxes with roofs that stick out, and canopies over the pavement."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.simulation.landscape.building import Building
from crowdfence.simulation.landscape.triangle_mesh import TriangleMesh

Colour = tuple[int, int, int]

PLASTER = (
    (208, 194, 166),
    (196, 172, 138),
    (178, 154, 132),
    (200, 180, 172),
    (168, 172, 168),
    (188, 148, 110),
    (150, 118, 98),
    (186, 186, 176),
)
ROOF_TILES = ((128, 80, 66), (112, 74, 62), (98, 82, 76), (84, 86, 92), (120, 92, 74))
CANOPY_HEIGHT_M = 3.3


@dataclass(slots=True)
class _Faces:
    """Collects flat faces with their colour."""

    corners: list[NDArray[np.float64]] = field(default_factory=list)
    colours: list[Colour] = field(default_factory=list)
    windows: list[bool] = field(default_factory=list)

    def quad(
        self, a: ArrayLike, b: ArrayLike, c: ArrayLike, d: ArrayLike, colour: Colour, windows: bool = False
    ) -> None:
        for triangle in ((a, b, c), (a, c, d)):
            self.triangle(*triangle, colour, windows)

    def triangle(
        self, a: ArrayLike, b: ArrayLike, c: ArrayLike, colour: Colour, windows: bool = False
    ) -> None:
        self.corners.append(np.array([a, b, c], np.float64))
        self.colours.append(colour)
        self.windows.append(windows)

    def block(
        self,
        low: NDArray[np.float64],
        high: NDArray[np.float64],
        colour: Colour,
        *,
        walls_with_windows: bool = False,
    ) -> None:
        """Closed box."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        w = walls_with_windows
        self.quad((x0, y0, z0), (x1, y0, z0), (x1, y0, z1), (x0, y0, z1), colour, w)
        self.quad((x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1), colour, w)
        self.quad((x1, y1, z0), (x0, y1, z0), (x0, y1, z1), (x1, y1, z1), colour, w)
        self.quad((x0, y1, z0), (x0, y0, z0), (x0, y0, z1), (x0, y1, z1), colour, w)
        self.quad((x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1), colour)
        self.quad((x0, y1, z0), (x1, y1, z0), (x1, y0, z0), (x0, y0, z0), colour)

    def gable(
        self, low: NDArray[np.float64], high: NDArray[np.float64], colour: Colour, wall: Colour
    ) -> None:
        """Closed ridge roof over the rectangle, the ridge along its longer side."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        along_x = x1 - x0 >= y1 - y0
        if along_x:
            ridge0, ridge1 = (x0, (y0 + y1) / 2, z1), (x1, (y0 + y1) / 2, z1)
            base = [(x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x0, y1, z0)]
        else:
            ridge0, ridge1 = ((x0 + x1) / 2, y0, z1), ((x0 + x1) / 2, y1, z1)
            base = [(x1, y0, z0), (x1, y1, z0), (x0, y1, z0), (x0, y0, z0)]
        a, b, c, d = base
        self.quad(a, b, ridge1, ridge0, colour)
        self.quad(c, d, ridge0, ridge1, colour)
        self.triangle(b, c, ridge1, wall)
        self.triangle(d, a, ridge0, wall)
        self.quad(a, d, c, b, wall)

    def building(self, foot_m: float) -> Building:
        corners = np.concatenate(self.corners)
        mesh = TriangleMesh(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))
        return Building(mesh, np.array(self.colours, np.uint8), np.array(self.windows), foot_m)


def house(
    rectangle: tuple[float, float, float, float],
    foot_m: tuple[float, float],
    storeys: int,
    rng: np.random.Generator,
) -> Building:
    """House on (west, south, east, north); `foot_m` = lowest and highest ground around it.

    Eaves stick out 0.6 to 1.4 m; three in five houses have a canopy 1.5 to 2.8 m deep along two sides."""
    west, south, east, north = rectangle
    floor = foot_m[1]
    top = floor + 3.1 * storeys + 0.4
    wall: Colour = PLASTER[int(rng.integers(len(PLASTER)))]
    roof: Colour = ROOF_TILES[int(rng.integers(len(ROOF_TILES)))]
    faces = _Faces()
    faces.block(
        np.array([west, south, foot_m[0] - 1.0]), np.array([east, north, top]), wall, walls_with_windows=True
    )
    eaves = float(rng.uniform(0.6, 1.4))
    out_low, out_high = np.array([west - eaves, south - eaves]), np.array([east + eaves, north + eaves])
    if rng.random() < 0.65:
        ridge = top + 0.30 * min(east - west, north - south)
        faces.gable(np.append(out_low, top - 0.15), np.append(out_high, ridge), roof, wall)
    else:
        faces.block(np.append(out_low, top - 0.1), np.append(out_high, top + 0.35), (126, 124, 120))
        hut = np.array([west + 3.0, south + 3.0])
        faces.block(np.append(hut, top + 0.35), np.append(hut + 3.0, top + 2.6), (150, 148, 144))
    if rng.random() < 0.6:
        depth = float(rng.uniform(1.5, 2.8))
        height = floor + CANOPY_HEIGHT_M
        cloth: Colour = ((176, 52, 46), (54, 96, 84), (222, 210, 186), (64, 84, 128))[int(rng.integers(4))]
        for low, high in (((west, south - depth), (east, south)), ((west, north), (east, north + depth))):
            faces.block(np.append(low, height), np.append(high, height + 0.22), cloth)
    return faces.building(floor)
