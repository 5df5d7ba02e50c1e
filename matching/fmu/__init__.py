"""Results for other programs: the tuned residual vehicle, or any model, as an FMU."""
