"""A controller that estimates unmeasured torques: its model, filter, state feedback, and how it steps."""
