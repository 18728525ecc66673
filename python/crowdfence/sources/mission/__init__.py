"""The native mission file (MCAP): its layout, reading and writing it."""
