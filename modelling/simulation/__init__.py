"""Time simulation of the nonlinear model on recorded inputs: start states, choice of steps, results."""
