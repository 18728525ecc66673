"""When each drone takes which image, and what goes wrong with it: a function of scenario and seed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from crowdfence.simulation.flight.flight import Flight
from crowdfence.simulation.flight.telemetry import PoseBias, Telemetry, noisy_poses, row_numbers, true_poses
from crowdfence.simulation.random_streams import Stream, stream
from crowdfence.simulation.scenarios.scenario import Scenario
from crowdfence.simulation.scene import Scene

TELEMETRY_MARGIN_S = 0.25
"""Telemetry starts and ends so long before and after the images."""

_MAX_JITTER_OF_FRAME = 0.4
_BLOCK_FRAMES = 512


@dataclass(frozen=True, slots=True)
class Capture:
    """One image of one drone, as planned and as it arrives."""

    drone: int
    frame: int
    """Number 0, 1, ... of the exposure."""
    t_s: float
    """True time of the exposure since the start of the mission."""
    stamp_ns: int
    """What the drone's clock says; increases from frame to frame."""
    dropped: bool
    """Taken but never delivered."""
    duplicate_of: int | None
    """Frame whose image is delivered again under this frame's stamp."""
    late_by_s: float
    """How much later than its stamp it arrives."""

    @property
    def arrival_ns(self) -> int:
        """On the drone's clock."""
        return self.stamp_ns + round(self.late_by_s * 1e9)


@dataclass(frozen=True, slots=True)
class DroneClock:
    """What one drone has all the time."""

    trigger_s: float
    """Exposures lag the common rhythm by so much."""
    offset_s: float
    """Stamps are ahead of the true time by so much."""
    joins_s: float
    leaves_s: float


@dataclass(frozen=True, slots=True)
class Schedule:
    """Captures and telemetry of all drones; any part can be made without the parts before it."""

    scenario: Scenario
    seed: int
    flight: Flight
    clocks: tuple[DroneClock, ...]
    biases: tuple[PoseBias, ...]

    def captures(self, drone: int) -> Iterator[Capture]:
        """Images of one drone while it is there, in the order of exposure."""
        for block in range(-(-self.scenario.frames // _BLOCK_FRAMES)):
            yield from self._block(drone, block)

    def exposure_s(self, drone: int, frame: int) -> float:
        """True time of an exposure."""
        return frame / self.scenario.fps + self.clocks[drone].trigger_s

    def telemetry(self, drone: int, from_s: float | None = None, to_s: float | None = None) -> Telemetry:
        """Rows of one drone with true time in [`from_s`, `to_s`); by default all of the mission's."""
        clock, trouble = self.clocks[drone], self.scenario.trouble
        start = max(clock.joins_s, 0.0) - TELEMETRY_MARGIN_S
        end = min(clock.leaves_s, self.scenario.duration_s + clock.trigger_s) + TELEMETRY_MARGIN_S
        start = start if from_s is None else max(from_s, start)
        end = end if to_s is None else min(to_s, end)
        numbers, noise = row_numbers(trouble, self.seed, drone, start, end)
        t_s = numbers / trouble.telemetry_hz
        true = true_poses(self.flight, drone, t_s)
        stamps = self.scenario.epoch_ns + np.rint((t_s + clock.offset_s) * 1e9).astype(np.int64)
        return Telemetry(t_s, stamps, true, noisy_poses(true, trouble, self.biases[drone], noise))

    def manifest(self) -> dict[str, Any]:
        """All parameters of the trouble and what was drawn per drone, ready for JSON."""
        drones = [
            {
                "name": name,
                "trigger_s": clock.trigger_s,
                "clock_offset_s": clock.offset_s,
                "joins_s": clock.joins_s if np.isfinite(clock.joins_s) else None,
                "leaves_s": clock.leaves_s if np.isfinite(clock.leaves_s) else None,
                "position_bias_m": bias.position_m.tolist(),
                "attitude_bias_deg": np.degrees(bias.attitude_rad).tolist(),
                "gimbal_bias_deg": np.degrees(bias.gimbal_rad).tolist(),
            }
            for name, clock, bias in zip(self.scenario.drone_names, self.clocks, self.biases, strict=True)
        ]
        return {"plan": asdict(self.scenario.trouble), "drones": drones}

    def _block(self, drone: int, block: int) -> Iterator[Capture]:
        trouble, clock = self.scenario.trouble, self.clocks[drone]
        rng = stream(self.seed, Stream.FRAMES, drone, block)
        fate, late, jitter = (
            rng.random(_BLOCK_FRAMES),
            rng.random(_BLOCK_FRAMES),
            rng.normal(size=_BLOCK_FRAMES),
        )
        most = _MAX_JITTER_OF_FRAME / self.scenario.fps
        first = block * _BLOCK_FRAMES
        whole_before = False  # a block's first frame never repeats one of the block before
        for frame in range(first, min(first + _BLOCK_FRAMES, self.scenario.frames)):
            t_s = self.exposure_s(drone, frame)
            if not clock.joins_s <= t_s < clock.leaves_s:
                whole_before = False
                continue
            k = frame - first
            off_s = clock.offset_s + float(np.clip(1e-3 * trouble.clock_jitter_ms * jitter[k], -most, most))
            dropped = bool(fate[k] < trouble.dropped)
            repeats = not dropped and whole_before and bool(fate[k] >= 1.0 - trouble.duplicated)
            yield Capture(
                drone,
                frame,
                t_s,
                self.scenario.epoch_ns + round((t_s + off_s) * 1e9),
                dropped,
                frame - 1 if repeats else None,
                1e-3 * trouble.late_ms if late[k] < trouble.late else 0.0,
            )
            whole_before = not dropped and not repeats


def build_schedule(scene: Scene) -> Schedule:
    """The schedule of `scene`: equal for equal scenario and seed."""
    scenario, trouble = scene.scenario, scene.scenario.trouble
    joins, leaves = dict(trouble.joins_s), dict(trouble.leaves_s)
    clocks, biases = [], []
    for drone in range(scenario.drones):
        rng = stream(scene.seed, Stream.CLOCK, drone)
        trigger, offset = rng.random(), rng.normal()
        clocks.append(
            DroneClock(
                1e-3 * trouble.trigger_spread_ms * trigger,
                1e-3 * trouble.clock_offset_ms * offset,
                joins.get(drone, -np.inf),
                leaves.get(drone, np.inf),
            )
        )
        biases.append(PoseBias.drawn(trouble, scene.seed, drone))
    return Schedule(scenario, scene.seed, scene.flight, tuple(clocks), tuple(biases))
