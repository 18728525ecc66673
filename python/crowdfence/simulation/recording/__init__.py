"""A scene recorded: frames made side by side, written as a mission file or an AirSim folder."""
