"""The test bed: rig, residual vehicle, control structures and manoeuvres."""
