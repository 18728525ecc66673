"""Results -> files, one module per format. Writers are atomic: they leave an older file intact on failure."""
