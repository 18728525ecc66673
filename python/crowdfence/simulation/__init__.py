"""Synthetic multi-drone missions with truth from the world: scene, people, flight, rendering, recording."""
