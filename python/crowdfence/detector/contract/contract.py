"""What a model expects and what its output means: one JSON document (schema 1) as frozen values.

    {"schema": 1, "name": "...", "version": "...", "licence": "...",
     "input": {...}, "output": {...},
     "sizes": null, "pictures": null, "calibration": null, "rates": null, "validity": null,
     "target_height_m": null, "about": null}

`docs/models.md` explains every key. Parsing refuses what it does not know: a contract that is guessed at
yields heatmaps that look right and are wrong.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from crowdfence.detector.contract.crowd_rules import PeopleRule
from crowdfence.detector.contract.json_section import JsonSection, is_number
from crowdfence.detector.contract.model_input import ModelInput, input_from_json
from crowdfence.detector.contract.model_output import PEOPLE_KINDS, ModelOutput, output_from_json
from crowdfence.detector.contract.picture_sizes import PictureSizes
from crowdfence.detector.picture_statistics import PictureRange
from crowdfence.errors import DetectorError

SCHEMA = 1
MAX_JSON_BYTES = 4_000_000
"""A contract with a large likelihood-ratio table takes some hundred kilobytes."""


@dataclass(frozen=True, slots=True)
class Validity:
    """Where the model was tested, each [low, high] or None for not stated."""

    gsd_m: tuple[float, float] | None = None
    """Metres on the ground per image pixel: distance / focal length in pixels."""
    distance_m: tuple[float, float] | None = None
    tilt_deg: tuple[float, float] | None = None
    """Angle of the ray below the horizon, 90 = straight down."""


@dataclass(frozen=True, slots=True)
class FinerCameras:
    """What was measured of cameras finer than those of the calibration: `finer` of the rates."""

    focal_px: float
    likelihood_ratio: dict[str, Any] = field(hash=False)
    """As that of the rates themselves."""
    validity: Validity
    """Where the model was tested with them."""


@dataclass(frozen=True, slots=True)
class Contract:
    """The whole document. `calibration`, `rates` and `about` are JSON objects still."""

    name: str
    input: ModelInput
    output: ModelOutput
    version: str | None = None
    licence: str | None = None
    sizes: PictureSizes | None = None
    """At which size it is shown pictures; None: as they are."""
    pictures: PictureRange | None = field(default=None, repr=False)
    """What the pictures looked like that it was tested on."""
    calibration: dict[str, Any] | None = field(default=None, hash=False)
    rates: dict[str, Any] | None = field(default=None, hash=False)
    validity: Validity | None = None
    target_height_m: float | None = None
    """Height above ground of what the heatmap marks."""
    about: dict[str, Any] | None = field(default=None, hash=False)
    """Anything else that its makers want to say."""

    @property
    def temperature(self) -> float:
        """Divides the logits; 1 without a calibration. Of a probability model it is part of the graph."""
        return float((self.calibration or {}).get("temperature", 1.0))

    @property
    def finer_cameras(self) -> FinerCameras | None:
        """None: nothing was measured of any."""
        told = (self.rates or {}).get("finer")
        return None if told is None else _finer(told)

    @property
    def needs_gsd(self) -> bool:
        """There is no heatmap without metres per pixel."""
        rule = self.output.rule
        if self.output.kind == "boxes" and isinstance(rule, PeopleRule) and rule.person_height_m is not None:
            return False
        return self.output.kind in ("density", *PEOPLE_KINDS)

    @property
    def uses_gsd(self) -> bool:
        """The heatmap depends on metres per pixel, where they are known."""
        return self.output.rule is not None or (self.sizes is not None and self.sizes.gsd_m is not None)

    @staticmethod
    def from_json(document: Mapping[str, Any]) -> Contract:
        """Parse a document of schema 1. DetectorError names the key, its value and what is allowed."""
        top = JsonSection(document)
        if top.raw("schema") != SCHEMA or isinstance(top.raw("schema"), bool):
            raise top.refuse("schema", str(SCHEMA))
        output = output_from_json(_required(top, "output"))
        contract = Contract(
            name=top.text("name"),
            version=top.text("version", None),
            licence=top.text("licence", None),
            input=input_from_json(_required(top, "input"), output),
            output=output,
            sizes=PictureSizes.from_json(top.section("sizes"), output),
            pictures=PictureRange.from_json(top.section("pictures")),
            calibration=_calibration(top),
            rates=_rates(top),
            validity=_validity(top.section("validity")),
            target_height_m=top.number("target_height_m", 0.0, None),
            about=top.free("about"),
        )
        top.done()
        return contract

    def to_json(self) -> dict[str, Any]:
        """The document, complete: `Contract.from_json(contract.to_json()) == contract`."""
        model_input = {name: _plain(getattr(self.input, name)) for name in ModelInput.__slots__}
        output = {name: _plain(getattr(self.output, name)) for name in ModelOutput.__slots__}
        output["rule"] = None if self.output.rule is None else self.output.rule.to_json()
        validity = self.validity
        return {
            "schema": SCHEMA,
            "name": self.name,
            "version": self.version,
            "licence": self.licence,
            "input": model_input,
            "output": output,
            "sizes": self.sizes and self.sizes.to_json(),
            "pictures": self.pictures and self.pictures.to_json(),
            "calibration": self.calibration,
            "rates": self.rates,
            "validity": validity and {name: _plain(getattr(validity, name)) for name in Validity.__slots__},
            "target_height_m": self.target_height_m,
            "about": self.about,
        }


def contract_from_text(text: str | bytes, source: str) -> Contract:
    """Parse JSON text; `source` begins every message."""
    if len(text) > MAX_JSON_BYTES:
        raise DetectorError(
            f"{source}: {len(text):,} bytes are too many for a contract; allowed: {MAX_JSON_BYTES:,}"
        )
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DetectorError(f"{source} is not JSON: {error}") from None
    return contract_of(document, source)


def contract_of(document: object, source: str) -> Contract:
    """Parse a JSON value; `source` begins every message."""
    try:
        return Contract.from_json(cast(Mapping[str, Any], document))
    except DetectorError as error:
        raise DetectorError(f"{source}: {error}") from None


def read_contract(path: Path) -> Contract:
    """Contract in a JSON file. OSError when it cannot be read."""
    with open(path, "rb") as file:
        return contract_from_text(file.read(MAX_JSON_BYTES + 1), str(path))


def _required(top: JsonSection, name: str) -> JsonSection:
    section = top.section(name)
    if section is None:
        raise DetectorError(f"{name} is missing")
    return section


def _calibration(top: JsonSection) -> dict[str, Any] | None:
    calibration = top.free("calibration")
    temperature = (calibration or {}).get("temperature", 1.0)
    if not is_number(temperature) or temperature <= 0.0:
        raise DetectorError(f"calibration.temperature is {temperature!r}; allowed: a finite number above 0")
    return calibration


def _rates(top: JsonSection) -> dict[str, Any] | None:
    rates = top.free("rates")
    for name in ("true_positive", "false_positive"):
        if rates is not None and rates.get(name) is not None:
            section = JsonSection(rates[name], f"rates.{name}")
            rate = section.number("rate", 0.0)
            low, high = section.number("low", 0.0, rate), section.number("high", 0.0, rate)
            if not 0.0 <= low <= rate <= high <= 1.0:
                raise DetectorError(
                    f"rates.{name} is {rate:g} in [{low:g}, {high:g}]; allowed: 0 <= low <= rate <= high <= 1"
                )
    if rates is not None and rates.get("finer") is not None:
        _finer(rates["finer"])
    return rates


def _finer(value: object) -> FinerCameras:
    section = JsonSection(value, "rates.finer")
    table, validity = section.free("likelihood_ratio"), _validity(section.section("validity"))
    return FinerCameras(section.number("focal_px", 0.0, above=True), table or {}, validity or Validity())


def _validity(section: JsonSection | None) -> Validity | None:
    if section is None:
        return None
    value = Validity(*(section.span(name) for name in ("gsd_m", "distance_m", "tilt_deg")))
    section.done()
    return value


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value
