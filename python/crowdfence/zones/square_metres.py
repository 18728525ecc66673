"""Areas as people read them."""


def square_metres(area_m2: float) -> str:
    """ "564 m2", "0.25 m2": a small crowd is not told as none."""
    return f"{area_m2:.2g} m2" if 0.0 < area_m2 < 1.0 else f"{area_m2:.0f} m2"
