"""The tuned loop once more, by another method: dynamic stiffness straight from the model files, no state space.

Nothing that the optimiser or the rest of the verification computes with is used here; a test holds that.
"""
