"""Where on Earth the local ENU frame lies (placeholder until the maps part lands)."""
