"""Pages of map, tolerances, fidelity and uncertainty: the verdict first, figures that act, data to calculate with."""

import csv
import io
import math
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest

import rigmatch as rm
from matching.fidelity import Band
from matching.match.map import Axis, Map, Point
from matching.match.tolerance import Spread, Tolerance, Varied
from matching.report import evidence, studies
from matching.report.acting import acting
from matching.report.evidence import attribution_figure, bands_figure, contributions, delay_curve, ishikawa
from matching.report.studies import map_figure
from matching.report.studies import plot_tolerance as plot
from modelling.display import files

EXAMPLES = Path(__file__).parents[2] / "examples"
STIFFNESS, MOTOR = "rig.shafts.flange.stiffness", "rig.inertias.motor.J"


def tables(html):
    """CSV tables of a page by the name that a browser saves them under."""
    parts = html.split('download="')[1:]
    texts = {part.split('"')[0]: unescape(part.split("charset=utf-8,")[1].split('"')[0]) for part in parts}
    return {name: list(csv.DictReader(io.StringIO(unquote(text)))) for name, text in texts.items()}


def page_of(result):
    """The page that is written, without its scripts and the marks of terms."""
    *_, others = files(result, "out")
    html = next(text for name, text in others.items() if name.endswith(".html"))
    return re.sub(r"</?abbr[^>]*>|<script>.*?</script>", "", html, flags=re.DOTALL)


def a_map(title="<map>"):
    """Matched at 1 ms, limited at 2 ms."""
    rows = [
        [
            Point(1e-3, y, "matched", 0.01 * y, 0.02, 0.005, True, 0.5 + y, (), objective=1.0, values={STIFFNESS: y}),
            Point(2e-3, y, "limited", 0.3, 0.4, 0.005, False, 0.1, ("so",), ("stability",)),
        ]
        for y in (1.0, 2.0)
    ]
    axes = Axis("loop.dead_time", "s", (1e-3, 2e-3), 1e-3), Axis(STIFFNESS, "N*m/rad", (1.0, 2.0), 1.0)
    return Map(title, (0.5, 30.0), *axes, tuple(map(tuple, rows)))


def test_a_map_says_what_to_choose_and_gives_every_point():
    html = page_of(a_map())
    assert "&lt;map&gt;" in html
    assert "<map>" not in html
    assert "2 of 4 matched" in html
    assert "over their tolerances, is 0.01, at dead time 1 ms, flange, stiffness 1 N·m/rad." in html
    assert "No better than where the case is" in html
    assert "Choose" not in html
    assert "Largest modulus margin at dead time 1 ms, flange, stiffness 2 N·m/rad" in html
    assert "dead time: 1 ms<" in html
    assert "no stable loop found" in html
    assert "at 2 of 4 points" in html
    rows = tables(html)["map.csv"]
    assert [(float(row["loop.dead_time [s]"]), row["status"]) for row in rows] == [
        (1e-3, "matched"), (2e-3, "limited"), (1e-3, "matched"), (2e-3, "limited"),
    ]  # fmt: skip
    assert [row[STIFFNESS] for row in rows] == ["1", "", "2", ""]


def test_a_map_shows_its_errors_in_the_terminal_and_in_a_notebook():
    """One row for each value of y, one column for each of x."""
    lines = str(a_map()).splitlines()
    assert lines[0] == "2 OF 4 MATCHED  Map: <map>"
    assert [line.split()[-2:] for line in lines if line.endswith(" 0.3")] == [["0.01", "0.3"], ["0.02", "0.3"]]
    assert all(value in a_map()._repr_html_() for value in ("2 of 4 matched", "0.01", "0.02"))


def test_fields_of_a_map_act_and_say_their_error():
    element = unescape(acting(map_figure(a_map()))[1])
    for words in ('"0.3"', "the case as it is", "response error, 0.5"):
        assert words in element


def a_study(stable=0.9):
    edges, counts = np.linspace(0.4, 0.7, 4), np.array([10, 60, 30])
    quantiles = {0.05: 0.45, 0.5: 0.55, 0.95: 0.65}
    intervals = {0.05: (None, 0.47), 0.5: (0.54, 0.56), 0.95: (0.64, 0.66)}
    drivers = ((STIFFNESS, 0.6), (MOTOR, 0.2), ("rig.inertias.rotor.J", 0.01))
    margin = Spread("modulus_margin", "", 0.56, 0.55, 0.05, quantiles, intervals, drivers, 0.81, 100, edges, counts)
    shares = {"stable": stable, "damped": 1.0, "all": stable}
    varied = tuple(Varied(name, 1.0, 0.9, 1.1, "", specimen) for name, specimen in ((STIFFNESS, False), (MOTOR, True)))
    return Tolerance("bed", 100, 0, varied, (margin,), shares, 0.5, 16.2)


def test_a_tolerance_study_says_what_to_tighten_and_what_fails():
    html = page_of(a_study())
    assert "90.0 % of 100 drawn beds are stable" in html
    assert "causes 60 % of the variance of modulus margin" in html
    to_do = html.split("What to watch")[0].split("What to do now")[1]
    assert "rotor" not in to_do  # its share is too small
    assert "motor" not in to_do  # the vehicle has the same one
    assert "0.45 (… to 0.47)" in html
    assert "0.65 (0.64 to 0.66)" in html
    assert "10.0 % of the beds are not stable" in html
    rows = tables(html)["tolerance.csv"]
    assert [int(row["draws"]) for row in rows] == [10, 60, 30]
    assert float(rows[0]["to"]) == pytest.approx(0.5)
    all_pass = page_of(a_study(1.0))
    assert "no drawn bed fails" in all_pass
    assert "every drawn bed keeps what a match asks" in all_pass
    assert "Order" not in all_pass


@pytest.fixture(scope="module")
def fidelity():
    return rm.fidelity(EXAMPLES / "fidelity" / "tab2.toml")


@pytest.fixture(scope="module")
def budget():
    return rm.uncertainty(EXAMPLES / "gum" / "end_gauge.toml")


def test_a_fidelity_says_what_to_improve_first(fidelity):
    found = fidelity
    html = page_of(found)
    gains = sorted((loss.gain for loss in found.attribution.losses), reverse=True)
    assert f"without it R_XiL would be {100 * gains[0]:.2f} percentage points higher" in html
    saved = tables(html)
    assert max(float(row["gain in R_XiL"]) for row in saved["attribution.csv"]) == pytest.approx(gains[0], rel=1e-6)
    assert {row["domain"] for row in saved["delay.csv"]} == set(found.fidelity.signals)


def test_a_budget_leads_with_the_statement(budget):
    found = budget
    html = unescape(page_of(found))
    assert found.statements[0] in html
    rows = tables(html)["contributions.csv"]
    assert sum(float(row["contribution"]) ** 2 for row in rows) == pytest.approx(
        found.measurands[0].propagation.first_order ** 2 / found.measurands[0].measurand.unit.scale ** 2, rel=1e-5
    )
    assert html.count("<svg") == 2


def test_every_measurand_has_its_data_and_says_what_decides():
    found = rm.uncertainty(EXAMPLES / "gum" / "impedance.toml", draws=10_000)
    html = page_of(found)
    saved = tables(html)
    assert {name: {row["measurand"] for row in rows} for name, rows in saved.items()} == {
        f"{name}_contributions.csv": {name} for name in "RXZ"
    }
    lists = unescape(html.split('class="first"')[1].split("<details")[0]).split("<h3>")
    watched = next(part for part in lists if part.startswith("What to watch"))
    assert "; Other" not in html
    for each in found.to_dict()["measurands"]:
        name, verdict = each["name"], each["first_order_check"]["verdict"]
        assert (f"{name}: propagation and Monte Carlo agree" in watched) == (verdict == "good")
        assert (f"{name}: JCGM 101 check" in watched) == (verdict != "good")
        reason = unescape(html).split(each["statement"], 1)[1][:120]
        assert ("do not decide" in reason) == (verdict == "open")


def on_page(html, name):
    """Caption of a figure, and whether its picture is there."""
    part = unescape(html.split(f'id="figure-{name}"')[1].split("</figure>")[0])
    return part.split("<figcaption>")[1].split("<")[0].strip(), "<svg" in part


def test_figures_of_a_map_hold_its_points():
    found = a_map()
    drawn = map_figure(found)
    panels = [axes for axes in drawn.axes if axes.get_xlabel()]
    for axes, errors in zip(panels, (found.errors(), found.errors("unmeasured")), strict=True):
        assert np.array_equal(np.ma.getdata(axes.collections[0].get_array()).ravel(), errors.ravel())
        ring = axes.get_lines()[-1].get_xydata().tolist()
        assert axes.get_xlabel() == "dead time in ms"  # and the data are in ms
        assert ring == [[1e3 * found.x.here, found.y.here]]
        assert axes.get_xlim() == pytest.approx((0.5, 2.5))
        ticks = [float(text.get_text()) for text in axes.get_xticklabels()]
        assert ticks == pytest.approx(axes.get_xticks().tolist())
        assert ticks == pytest.approx([1.0, 2.0])
    assert on_page(page_of(found), "map") == (studies.MAP_CAPTION + studies.CAPTION_OF_RING, True)


def test_figures_of_a_tolerance_study_hold_its_histogram_and_drivers():
    study = a_study()
    drawn = plot(study)
    left, right = drawn.axes
    assert left.patches[0].get_data().values.tolist() == [10, 60, 30]
    assert left.patches[0].get_data().edges.tolist() == study.spreads[0].edges.tolist()
    assert [line.get_xdata()[0] for line in left.get_lines()] == [0.56, 0.5]
    bars = [(bar.get_y() + bar.get_height() / 2, bar.get_width()) for bar in right.patches]
    assert bars == [(0, 1), (1, 20), (2, 60)]
    assert on_page(page_of(study), "tolerance") == (studies.TOLERANCE_CAPTION, True)


def test_a_result_that_is_the_same_on_every_bed_has_no_empty_panel():
    study = a_study()
    (margin,) = study.spreads
    held = replace(margin, name="target_mode_2_frequency", unit="Hz", mean=8.0, nominal=8.0, standard_deviation=1e-12)
    error = replace(margin, name="target_mode_2_frequency_error", drivers=((STIFFNESS, 0.9), (MOTOR, 0.0)))
    study = replace(study, spreads=(margin, held, error))
    axes = plot(study).axes
    assert [one.get_xlabel() for one in axes[::2]] == [
        "modulus margin", "target mode 2: frequency over that of the vehicle, less 1",
    ]  # fmt: skip
    assert all(len(one.patches) for one in axes)
    assert len(axes[3].get_yticklabels()) == 1  # no bar of nothing
    assert "not drawn: target mode 2 frequency." in page_of(study)


def a_band(low, high, nrmse, amplitude):
    return Band(low, high, 1.0, 0.5, nrmse, amplitude, 1 - amplitude, 1.0, None, None)


def test_figures_of_a_fidelity_hold_its_delays_losses_and_bands(fidelity):
    stated = fidelity
    bands = (a_band(0, 2, 0.99, 0.25), a_band(2, 6, 0.9, 1.0), a_band(6, math.inf, 0.98, 0.5))
    by_signal = {"system_dynamics": {"speed": bands}, "residual_vehicle_model": {"torque": bands[1:]}}
    recorded = replace(stated, bands=by_signal)
    drawn = {"delay": delay_curve(stated), "attribution": attribution_figure(stated), "bands": bands_figure(recorded)}
    (axes,) = drawn["delay"].axes
    curve, half, *marks = axes.get_lines()
    f_max = stated.fidelity.f_max
    assert half.get_xydata().tolist() == [[1000 / (6 * f_max), 0], [1000 / (6 * f_max), 0.5], [0, 0.5]]
    assert np.interp(1000 / (6 * f_max), *curve.get_xydata().T) == pytest.approx(0.5, abs=1e-3)  # Eq. 20
    points = {tuple(point) for line in marks for point in line.get_xydata()}
    signals = [signal for members in stated.fidelity.signals.values() for signal in members]
    known = [signal for signal in signals if signal.delay.nearest is not None]
    assert points == {(1000 * abs(signal.delay.nearest), signal.delay_fidelity) for signal in known}
    (axes,) = drawn["attribution"].axes
    losses = stated.attribution.losses[:15]
    assert [bar.get_width() for bar in axes.patches][: len(losses)] == [100 * loss.gain for loss in losses]
    assert [text.get_text() for text in axes.get_yticklabels()] == [f"{loss.signal}: {loss.cause}" for loss in losses]
    first, second = drawn["bands"].axes
    places = [(bar.get_x() + bar.get_width() / 2, bar.get_y(), bar.get_height()) for bar in first.patches[:6]]
    assert places == [pytest.approx(bar) for bar in (
        (1, 0, 0.25), (1, 0.25, 0.75), (4, 0, 10), (4, 10, 0), (6.45, 0, 1), (6.45, 1, 1),
    )]  # fmt: skip
    assert [bool(bar.get_hatch()) for bar in first.patches[:6]] == [False, True] * 3
    assert [bar.get_height() for bar in second.patches[:4]] == pytest.approx([10, 0, 1, 1])
    assert first.get_xlim() == pytest.approx((0, 1.18 * 6))
    html = page_of(recorded)
    for name, caption in evidence.CAPTIONS.items():
        assert on_page(html, name) == (caption, True)


def test_figures_of_a_budget_hold_its_contributions(budget):
    found = budget
    result = found.measurands[0]
    drawn = {"contributions": contributions(result), "ishikawa": ishikawa(result)}
    (axes,) = drawn["contributions"].axes
    widths = [bar.get_width() for bar in axes.patches]
    assert widths == sorted(widths, reverse=True)
    if result.method == "monte_carlo":  # by how much the variance would fall, in %
        assert widths == pytest.approx([100 * row.share for row in result.rows if row.share > 0])
        assert "known exactly" in axes.get_xlabel()
    else:
        rows = [row for row in result.rows if row.contribution > 0]
        assert widths == pytest.approx([row.contribution / result.measurand.unit.scale for row in rows])
        combined = result.propagation.first_order / result.measurand.unit.scale
        assert axes.get_lines()[0].get_xdata()[0] == pytest.approx(combined)
    (axes,) = drawn["ishikawa"].axes
    causes = {row.cause for row in result.rows if row.standard_uncertainty > 0}
    uncertain = [row for row in result.rows if row.standard_uncertainty > 0]
    assert len(axes.get_lines()) == len(causes) + len(uncertain)  # a branch each, and a twig each
    html = page_of(found)
    for name in drawn:
        caption, picture = on_page(html, name)
        assert caption
        assert picture
