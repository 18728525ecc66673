"""What the shipped detector finds in the pictures of a mission, made once: a mission can then be flown again
with other poses and stamps, and no picture is looked at twice."""

from __future__ import annotations

import hashlib
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import crowdfence as cf
from crowdfence.config import ProjectionConfig
from crowdfence.detector.shipped import shipped_model
from crowdfence.pipeline.detect import heatmap_source


def model_sha() -> str:
    """The first 12 digits of the shipped model's SHA-256."""
    return hashlib.sha256(shipped_model().read_bytes()).hexdigest()[:12]


def with_heatmaps(path: Path) -> cf.Recording:
    """The recording of a mission, with the detector's heatmaps as if they had been recorded."""
    recording = cf.open_recording(path)
    kept = path.with_suffix(f".{model_sha()}.heatmaps")
    if not kept.exists():
        kept.write_bytes(pickle.dumps(_found(recording)))
    found = pickle.loads(kept.read_bytes())
    frames = (
        replace(one, pixels=replace(one.pixels, heatmap=partial(found.__getitem__, number)))
        for number, one in enumerate(recording.frames)
    )
    return replace(recording, frames=tuple(frames))


def _found(recording: cf.Recording) -> list:
    """One heatmap a frame."""
    source = heatmap_source(cf.Detector(), cf.open_terrain(recording), ProjectionConfig().max_range_m)
    with ThreadPoolExecutor(2) as executor:
        return list(executor.map(source.heatmap_of, recording.frames))
