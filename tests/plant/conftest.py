from plant.marks import needs_compiler


def pytest_itemcollected(item):
    """Every test of this folder runs the plant."""
    item.add_marker(needs_compiler)
