"""XiL fidelity of a test bed from a case file, with its uncertainty, its spectrum and the attribution of its loss."""
