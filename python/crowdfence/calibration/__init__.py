"""Heatmaps whose 0.7 means 70 percent: a correction fitted on missions and written into the model."""
