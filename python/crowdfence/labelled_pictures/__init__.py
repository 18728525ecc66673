"""Photographs with annotations: people and crowds outlined by somebody, as truth for a detector."""
