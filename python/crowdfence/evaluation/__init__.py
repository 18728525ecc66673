"""How good a crowd map is (equation 4), and how good the detector is that made it.

The map, against truth:

- `iou`               mean intersection over union inside what the fleet has seen
- `threshold_sweep`   the same at many thresholds at once
- `replay`            a recording under several configurations, scored

The detector, on labelled missions (`labelled_missions`, `labelled_pass`, `model_quality`):

- `cells`             rates, IoU, precision, reliability of heatmap cells by distance, tilt, mission
- `voxels`            rates per voxel observation and how strongly a mean value speaks for crowd
- `statistics`        bins, intervals over missions, monotone fits
"""
