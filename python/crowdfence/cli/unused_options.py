"""Options that somebody gave and nobody would read: refused, because who gives one counts on it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import fields

import typer

from crowdfence.cli.option_sets import EvidenceOptions, PaperOptions, ZoneOptions
from crowdfence.config import MethodConfig

_CLOSE_NOTHING = ("threshold", "static_zones", "stale_after_s")
"""What the map of another class than crowd takes of `ZoneOptions`."""
_OF_SITES = ("min_area_m2",)
"""What landing sites take besides."""


def refuse_unused(context: typer.Context, names: Collection[str], why: str) -> None:
    """ValueError for the first of these parameters that stands on the command line."""
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if parameter.name in names and source is not None and source.name == "COMMANDLINE":
            raise ValueError(f"{parameter.opts[0]} does nothing {why}; leave it out")


def refuse_options_of_other_methods(context: typer.Context, configs: Collection[MethodConfig]) -> None:
    """The same for parameters that none of these methods has."""
    from crowdfence.zones.belief import FORGET_TO_PRIOR

    known = {field.name for config in configs for field in fields(config)}
    methods = sorted({config.name for config in configs})
    of_methods = (*EvidenceOptions.__annotations__, *PaperOptions.__annotations__)
    why = f"with --method {', '.join(methods)}"
    refuse_unused(context, [name for name in of_methods if name not in known], why)
    if "evidence" not in methods:
        refuse_unused(context, ["far_every_s"], f"{why}: every look takes in all of its picture")
    if not any(method in FORGET_TO_PRIOR for method in methods):
        refuse_unused(context, ["opening_looks"], f"{why}, which opens zones without looks")


def refuse_zone_options(context: typer.Context, layer: str) -> None:
    """The same for what shapes zones, on the map of a class that closes nothing."""
    from crowdfence.sources.layers import LANDING_SITE

    taken = (*_CLOSE_NOTHING, *(_OF_SITES if layer == LANDING_SITE else ()))
    shaping = [name for name in ZoneOptions.__annotations__ if name not in taken]
    refuse_unused(context, shaping, f"with --layer {layer}, of which no zones are made")


def refuse_of(context: typer.Context, uses: Mapping[str, Collection[str]], chosen: str, why: str) -> None:
    """The same for parameters that name those which use them, `chosen` not among them."""
    for name, users in uses.items():
        if chosen not in users:
            refuse_unused(context, [name], f"{why}; it is for {', '.join(users)}")
