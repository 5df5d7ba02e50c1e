"""Truth plant: makes recordings with hidden effects for testing the diagnosis. Shares no code with the product.

`make_case(system, effects, size, noise, seed)` gives a `Case`; its `answer` says what was hidden, and
`write(folder)` writes model.toml, recording.csv and holdout.csv. `orders(n, seed)` gives a list of
orders; `order.make()` makes the case.
"""

from plant.calibrate import OutOfReach
from plant.case import Case, make_case
from plant.hidden import Hidden
from plant.orders import Order, orders

__all__ = ["Case", "Hidden", "Order", "OutOfReach", "make_case", "orders"]
