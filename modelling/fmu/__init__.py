"""Models as functional mock-up units (FMI 2.0 and 3.0, co-simulation): C by CasADi, stepped as rigmatch steps."""
