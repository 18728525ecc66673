"""Films with a flight log: DJI subtitles, PX4 ULog, MAVLink telemetry."""
