"""The XiL fidelity of signals: partial measures, delay, total, spread, and a smooth form for optimisers."""
