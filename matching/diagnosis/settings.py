"""The numbers by which a diagnosis searches for causes and accepts them, with unit, meaning and origin."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DiagnosisSettings:
    """What a diagnosis searches and accepts by. "Trial": chosen on recordings that do not judge it (tests/campaign,
    seeds 9311 and 2611).

    Attributes
    ----------
    most_causes : int
        Causes that are named at most. A third one is rarely right (campaigns).
    chance : float
        Probability with which a cause that changes nothing is accepted; one-sided, of the block bootstrap.
    slight_rise : float
        Of a sensor's mean square on unseen data, up to which a rise does not matter: 2 % of its error.
    parts, fewest_parts : int
        Blocks of the recordings that are left out in turn: each fit keeps five sixths of the data, and a simulation of
        each costs less than a Jacobian.
    block_memories : float
        Length of a block at least, in times the memory of the residual (its integrated autocorrelation time): an
        exponential correlation has then fallen to 2 %.
    blocks : int
        Parts into which unseen data are cut for the bootstrap: longer than an oscillation, and enough to draw from.
    draws : int
        Of the bootstrap: the standard error of a probability of 1 % is then 0.2 %.
    candidates, kinds : int
        Most promising candidates that are refitted in a round, and further kinds, each at its most promising place.
        Trial.
    beside : int
        Further candidates at the components of the causes so far: a cause takes what another one does at its component
        as far as it can, and the screening promises little of that. What warms changes in friction and drag.
    places : int
        Further places at which the kind that explains most is refitted, where it leaves more than noise: a drivetrain
        of one motor and two wheels has four shafts.
    exchanged, pairs : int
        Candidates that are refitted in the place of each of several causes, and pairs that are. Trial.
    paired : int
        Best candidates of which pairs are screened.
    pair_gain : float
        Share of what the best candidate alone would leave beyond noise that a pair promises, from which it is looked
        at. Trial.
    wider_gaps : tuple of float
        Times the fitted free play, from which a fit over short windows begins again. Trial.
    least_share : float
        Of the misfit beyond noise that a cause has to explain. A kind that explains a tenth of it usually imitates a
        cause that the vocabulary lacks. Trial.
    explains : float
        Share of the misfit on unseen data, beyond noise and in the sensor where most, that a cause explains to stand in
        the extended model. What explains less of one recording often harms another. Trial (design recordings).
    kind_rest : float
        What a free force at the place of a cause still predicts of unseen data, over what the cause itself explains,
        from which nothing is said for its kind. Trial.
    map_leaves : float
        Of the misfit that is left with a cause: what the input of a machine, times a curve over its speed or waves over
        its angle, leaves in the place of the cause, below which that only stands for the map of the machine and stays
        out. 0.22 for a dip in a map that quadratic drag stood for, 0.83 for the dry friction of a robot axis.
        Trial.
    kind_at_bound : float
        Most that is said for a kind of which a value ended at the bound of its range: it was not found.
    named : float
        Share of a kind from which the answer gives its name; below it says what the cause is most like.
    beyond : float
        Standard uncertainties by which the values of a cause, all together, differ from those of no effect.
    harms, helps : float
        Of the error of all sensors on a second recording: a cause with which it rises by more than 2 % stays out of the
        extended model; one with which it falls by more than a tenth is in. Trial.
    beyond_promise : float
        Times what the screening promises that a refit gains at most, where sensors are weighted by what the model
        leaves. By noise there is no such bound: a drift hides what began it. Trial.
    judged : int
        Hypotheses of a round that are compared on unseen data, best first, before the search gives up.
    explains_almost_all, promising : float
        A round ends where a candidate explains this share of the misfit beyond noise and no other promises that share
        of the best decrease of χ². Trial.
    near_best : int
    near_ratio : float
        Hypotheses that are fitted to their end and with sharper friction to be compared, and up to how many times the
        best's χ². Trial.
    iterations : int
        Of a fit near the best that has not ended after those of a first comparison. Trial.
    rounds, moves : int
        Of adding causes and settling them, and moves at most until they are settled.
    fine_rivals : int
        Rivals of a cause that are fitted as finely as a hypothesis at the noise.
    out_of_question : float
        Difference of χ² from which a rival at the noise is none: a share of the evidence below 1e-13.
    windowed : int
        Fits over short windows in a whole search, which take many times as long.
    refits : int
        Of a whole search: five rounds and as many exchanges.
    search_share : float
        Of the time that a diagnosis may take; the rest is for the final fit of the best and its rivals.
    processor_seconds : float
        Time of the processor that a diagnosis may take where the caller sets no other limit, s: what somebody waits for
        at a bench. Recordings that one of the known effects explains take a tenth of it.
    reserved : float
        Share of that time which is kept for what cannot be cut short: what is begun is finished, the figures, and the
        report. Of 24 inertias and 18 000 samples it takes 20 s.
    left_by_model : float
        Times the noise that the best hypothesis leaves in a sensor, from which the model is taken as
        imperfect and sensors are weighted by what it leaves: more than a noise that is stated too small.
    clearly_beyond : float
        Times the noise that is left in a sensor without a cause, from which one that leaves noise alone needs no unseen
        data: uneven steps and rounded channels leave a few per cent. Trial.
    far_from_noise : float
        Times the noise that a model leaves in a sensor, from which weights by noise are not worth more than one cause:
        an encoder that is said to be precise would decide everything. Trial.
    base_iterations : int
        Of a fit of the model as given. Twenty left one fit in three unfinished (perfect models, tests/campaign).
    base_starts, base_fits : int
        Points over the ranges of the uncertain quantities at which χ² is looked at, and from how many of them it is
        fitted, where the fit from the stated values leaves more than noise. With 32 and 4 every perfect model that
        began −50 to +80 % off was reached (tests/campaign/perfect.py, seed 4907).
    clearly_lower : float
        Times the χ² of the fit from the stated values, from which another minimum is taken.
    window : int
        Readings of all sensors in which causes are searched for: 37 s at 1 kHz and four sensors. Their size is fitted
        to all data.
    """

    most_causes: int = 3
    chance: float = 0.01
    slight_rise: float = 0.04
    parts: int = 6
    fewest_parts: int = 3
    block_memories: float = 2.0
    blocks: int = 16
    draws: int = 2000
    candidates: int = 7
    kinds: int = 5
    beside: int = 2
    places: int = 4
    exchanged: int = 4
    pairs: int = 2
    paired: int = 10
    pair_gain: float = 0.2
    wider_gaps: tuple[float, ...] = (1.6, 4.0)
    least_share: float = 0.15
    explains: float = 0.5
    kind_rest: float = 0.3
    map_leaves: float = 0.5
    kind_at_bound: float = 0.4
    named: float = 0.5
    beyond: float = 2.0
    harms: float = 0.02
    helps: float = 0.1
    beyond_promise: float = 3.0
    judged: int = 6
    explains_almost_all: float = 0.9
    promising: float = 0.4
    near_best: int = 6
    near_ratio: float = 2.0
    iterations: int = 60
    rounds: int = 2
    moves: int = 6
    fine_rivals: int = 4
    out_of_question: float = 60.0
    windowed: int = 4
    refits: int = 60
    search_share: float = 0.7
    processor_seconds: float = 120.0
    reserved: float = 0.2
    left_by_model: float = 3.0
    clearly_beyond: float = 1.2
    far_from_noise: float = 100.0
    base_iterations: int = 80
    base_starts: int = 32
    base_fits: int = 4
    clearly_lower: float = 0.8
    window: int = 150_000
