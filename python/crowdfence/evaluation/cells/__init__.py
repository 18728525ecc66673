"""What a detector is worth per cell of its heatmaps."""
