"""Image -> heatmap: the shipped crowd detector, and anyone else's model under a stated contract."""
