"""Everybody in a scene: crowds, lone walkers and cyclists, how they look and how they move."""
