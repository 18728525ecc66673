"""Recordings of AirSim and Cosys-AirSim."""
