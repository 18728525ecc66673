"""Where the contract of a model comes from. The first source that exists is used, and must be complete:

1. the sidecar `model.crowdfence.json` beside `model.onnx`
2. the ONNX metadata key "crowdfence"
3. the metadata that Ultralytics writes
4. the metadata that the QGIS plugin Deepness reads
5. `preprocessor_config.json` of Hugging Face beside the model, when the caller states the output
6. a contract that comes with crowdfence, for a file of exactly that checksum
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from crowdfence.detector.contract import deepness, hugging_face, ultralytics
from crowdfence.detector.contract.contract import Contract, contract_from_text, contract_of, read_contract
from crowdfence.detector.contract.model_face import ModelFace
from crowdfence.errors import DetectorError

METADATA_KEY = "crowdfence"
KNOWN_CONTRACTS = Path(__file__).parent.parent / "models"
"""Contracts of models that anybody may fetch but that do not come with crowdfence."""
SIDECAR_SUFFIX = ".crowdfence.json"


@dataclass(frozen=True, slots=True)
class FoundContract:
    contract: Contract
    source: str
    """For people: the file or metadata that it was read from."""


def sidecar_path(model: Path) -> Path:
    return model.with_suffix(SIDECAR_SUFFIX)


def load_contract(path: str | PathLike[str]) -> Contract:
    """Contract of a model (`.onnx`) or in a JSON file (any other name).

    DetectorError when there is none or it is not valid, OSError when the file cannot be read.
    """
    path = Path(path)
    if path.suffix.lower() != ".onnx":
        return read_contract(path)
    from crowdfence.detector.onnx_session import open_session

    return find_contract(open_session(path).face).contract


def find_contract(face: ModelFace, output: Mapping[str, Any] | None = None) -> FoundContract:
    """Look in the order above. `output` is the "output" object of a contract, for step 5 only.

    DetectorError names the source, the key and what is allowed, or the places where nothing was found.
    """
    sidecar = sidecar_path(face.path)
    if sidecar.is_file():
        return FoundContract(read_contract(sidecar), str(sidecar))
    if METADATA_KEY in face.metadata:
        source = f'{face.path}, metadata "{METADATA_KEY}"'
        return FoundContract(contract_from_text(face.metadata[METADATA_KEY], source), source)
    for convention in (ultralytics, deepness):
        if convention.applies(face):
            source = f"{face.path}, metadata of {convention.NAME}"
            return FoundContract(contract_of(_converted(convention.document, face, source), source), source)
    config = hugging_face.config_path(face)
    if config.is_file():
        source = str(config)
        return FoundContract(
            contract_of(_converted(hugging_face.document, face, source, output), source), source
        )
    if (known := _known_contract(face.path)) is not None:
        return FoundContract(read_contract(known), f"{known.name}, which comes with crowdfence")
    raise DetectorError(
        f"{face.path} says neither what it expects nor what its output means: no {sidecar.name} beside it, "
        f'no metadata "{METADATA_KEY}", none of Ultralytics or Deepness, no {config.name}; '
        "write a contract (docs/models.md)"
    )


def _known_contract(model: Path) -> Path | None:
    """The contract in the package whose `about.sha256` is that of the file."""
    digest = hashlib.sha256(model.read_bytes()).hexdigest()
    for path in sorted(KNOWN_CONTRACTS.glob(f"*{SIDECAR_SUFFIX}")):
        if (read_contract(path).about or {}).get("sha256") == digest:
            return path
    return None


def _converted(document: Any, face: ModelFace, source: str, *more: Any) -> Any:
    try:
        return document(face, *more)
    except DetectorError as error:
        raise DetectorError(
            f"{source}: {error}; a contract in {sidecar_path(face.path).name} takes its place"
        ) from None
