"""XiL fidelity measures (Eqs. 13–23)."""
