"""Truth plant: makes recordings with hidden effects for testing the diagnosis. Shares no code with the product.

`make_case(system, effects, size, noise, seed)` gives a `Case`; its `answer` says what was hidden, and
`write(folder)` writes model.toml, recording.csv and holdout.csv. `campaign_cases(n, seed)` gives a balanced list of
orders; `order.make()` makes the case.
"""

from plant.calibrate import OutOfReach
from plant.campaign import Order, campaign_cases
from plant.case import Case, make_case
from plant.hidden import Hidden

__all__ = ["Case", "Hidden", "Order", "OutOfReach", "campaign_cases", "make_case"]
