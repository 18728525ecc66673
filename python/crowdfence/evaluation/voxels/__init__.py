"""What a detector is worth per voxel observation: one frame, one voxel in view, one mean value."""
