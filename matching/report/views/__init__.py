"""How results look in a notebook: ``plot(result)`` gives a Matplotlib figure, ``html(result)`` a table."""
