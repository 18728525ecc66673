"""How good a crowd map is, and what it needs to know: IoU (equation 4), detector rates, prior, ground truth.

Each module stands alone; import what is needed from it:

- `iou`               mean intersection over union inside what the fleet has seen
- `detector_rates`    TPR, FPR, TNR, FNR of a detector from heatmaps and masks
- `detector_quality`  IoU, precision, recall, rates, reliability by distance, tilt, mission, with intervals
- `voxel_rates`       rates per voxel observation and how strongly a mean value speaks for crowd
- `calibration`       does 0.7 mean 70 percent?
- `landing_prior`     P(A = 1) from the share of the terrain on which a drone could land
- `crowd_regions`     silhouettes of people -> crowd regions of an image
- `projected_truth`   crowd regions of images -> labels of the terrain's voxels
- `world_truth`       positions of people -> labels of the terrain's voxels
- `crowd_ground`      positions of people -> the outline of each crowd, without voxels
- `ground_labels`     positions of people -> labels of an image's cells
- `truth_over_time`   either truth, instant by instant
- `replay`            a recording under several configurations, scored
"""
