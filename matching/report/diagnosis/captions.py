"""The captions of the figures of a diagnosis, for pages too that others draw for."""

CAPTIONS = {
    "discrepancy": "What no named cause explains: a torque beside the extended model that would take most of it, with "
    "a band of two standard uncertainties. What the model's own parameters can take is not in it.",
    "errors": "Simulation of held-out data, which no fit used. At 1 the error equals the sensor's stated noise.",
    "unseen": "Held-out data. Left: around the largest error of the base model. Right: measured minus simulated over "
    "all held-out data, linear near zero and logarithmic beyond.",
    "time": "Fitted data: measured minus simulated over time (pale) and its running mean.",
    "where": "Measured minus simulated over the motion at the sensor's component; dots are samples, lines the mean of "
    "a bin. A step at zero speed indicates dry friction, a kink over the twist free play or hardening, a wave over "
    "the angle torque ripple.",
    "spectrum": "Amplitude of the residual over frequency and over orders of the rotation. White noise of the stated "
    "size lies at 1.",
    "balance": "Torque that the measurement requires in addition to the base model, for each component alone (smoothed "
    "with the linear model, without differentiation). It shows where to look, not the cause: neighbouring components "
    "share what no sensor separates.",
}
