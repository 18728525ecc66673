"""Fixed cameras around a square: the data sets Wildtrack and MultiviewX, as recordings on flat ground."""
