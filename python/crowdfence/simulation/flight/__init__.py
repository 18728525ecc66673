"""How the drones fly, where their cameras look, and the poses that they log."""
