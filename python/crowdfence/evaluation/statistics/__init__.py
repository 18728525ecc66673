"""Bins, intervals and monotone fits that both the cells and the voxels need."""
