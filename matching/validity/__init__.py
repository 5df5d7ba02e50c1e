"""How far a test bed's answer can be trusted: measurement uncertainty (GUM) and XiL fidelity."""
