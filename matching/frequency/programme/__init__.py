"""The nonlinear programme of a match: closed loop, objective and constraints as CasADi functions with derivatives."""
