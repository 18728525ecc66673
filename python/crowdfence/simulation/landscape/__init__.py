"""Landscapes: ground, road, buildings and things, made from a plan and a seed."""

from crowdfence.simulation.landscape.build import build_landscape
from crowdfence.simulation.landscape.ground import Cover, Ground
from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.landscape.props import PROP_KINDS, PropKind, Props
from crowdfence.simulation.landscape.road import CentreLine, Road
from crowdfence.simulation.landscape.triangle_mesh import TriangleMesh

__all__ = [
    "PROP_KINDS",
    "CentreLine",
    "Cover",
    "Ground",
    "Landscape",
    "PropKind",
    "Props",
    "Road",
    "TriangleMesh",
    "build_landscape",
]
