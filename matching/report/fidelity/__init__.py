"""Views of an XiL fidelity: figures and text."""
