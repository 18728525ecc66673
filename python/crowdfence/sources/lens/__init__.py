"""What a camera's lens is known by: calibration files, and what pictures say of themselves."""
