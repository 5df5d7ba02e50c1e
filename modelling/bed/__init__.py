"""The controlled test bed: residual vehicle, control loop with its structures, feed-forward, manoeuvres."""
