"""Imports run one way, and what judges the program shares nothing with it."""

from graphlib import TopologicalSorter

from structure.imports import PACKAGES, ROOT, arrows, imported

INDEPENDENT = ("tests/plant/*.py", "tests/virtual_bed/bed.py")  # truths that recordings are made with


def test_modelling_knows_nothing_of_matching():
    assert {
        (source, target)
        for source, targets in arrows().items()
        for target in targets
        if source.startswith("modelling") and not target.startswith("modelling")
    } == set()


def test_no_module_imports_itself_round_a_corner():
    TopologicalSorter(arrows()).prepare()  # CycleError names the modules


def test_the_truth_plant_imports_nothing_of_the_program():
    files = [path for pattern in INDEPENDENT for path in ROOT.glob(pattern) if not path.name.startswith("test_")]
    assert len(files) > 15
    own = (*PACKAGES, "rigmatch")
    assert [(path.name, name) for path in files for name in imported(path) if name.split(".")[0] in own] == []
