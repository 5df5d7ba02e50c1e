"""A controller that estimates what nobody measures: its model, filter, state feedback, and how it steps."""
