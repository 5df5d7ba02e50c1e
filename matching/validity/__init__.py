"""What a test bed's results are worth: measurement uncertainty (GUM) and XiL fidelity."""
