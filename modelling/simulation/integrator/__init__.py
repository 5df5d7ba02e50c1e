"""Fixed-step integration of one model over recorded inputs: compiled C where there is a compiler, else CasADi."""
