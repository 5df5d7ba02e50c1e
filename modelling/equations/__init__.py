"""From a system to its equations of motion (SymPy) and to compiled functions of state, inputs, parameters (CasADi)."""
