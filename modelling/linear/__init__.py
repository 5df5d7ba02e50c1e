"""The model linearised: mass and spring elements, state space, frequency responses, steady motion."""
