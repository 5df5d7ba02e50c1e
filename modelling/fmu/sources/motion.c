/* A model in motion: its values, how they are set and read, and how it steps. Knows nothing of FMI.
 *
 * model.h holds sizes, names and start values, model.c the functions that CasADi wrote:
 *
 *   constants(p, contact) -> c, delays    what follows from the parameters alone
 *   field(x, u, c)        -> xdot
 *   reading(x, u, c, t)   -> y
 *
 * Classical Runge-Kutta of order four. A communication step is cut into the fewest equal steps that are none longer
 * than 1/simulation.steps_per_second, so it may have any length. Inputs are held over it, or follow their slopes.
 * Delayed inputs and outputs look back over the steps taken.
 * Nothing is allocated here. Functions return 0 where they fail, and say why in the motion's message.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

#define CASADI_SYMBOL_EXPORT static
#include "model.c"

/* where things stand among the values; a value reference of FMI is an index into them */
enum {
    TIME,
    INPUTS,
    OUTPUTS = INPUTS + N_INPUTS,
    PARAMETERS = OUTPUTS + N_OUTPUTS,
    STATES = PARAMETERS + N_PARAMETERS,
    N_VALUES = STATES + N_STATES,
    STEPS_PER_SECOND = STATES - 1 /* the last parameter */
};

#define MOST_STEPS 1e7 /* in one communication step */

#include "slave.h"

/* An internal step that was taken: what it began with, and its rate at the end. Kept as long as delays look back. */
typedef struct {
    double time, span, x[N_STATES], rate[N_STATES], end_rate[N_STATES], u[N_INPUTS + 1], slope[N_INPUTS + 1];
} Taken;

/* Flat, so that copying it saves it. */
typedef struct {
    Phase phase;
    double value[N_VALUES];
    double slope[N_INPUTS + 1]; /* of the inputs, over the next communication step */
    double contact;             /* s over which the damping of a closing lash sets in: one internal step */
    double constant[N_CONSTANTS + 1], delay[N_INPUTS + N_OUTPUTS + 1], longest; /* s, of inputs, then outputs */
    int constants_due, outputs_due;
    long long taken;         /* internal steps so far */
    Taken step[N_TAKEN + 1]; /* the last of them, in a ring; none where nothing is delayed */
    Taken replaced[N_TAKEN + 1]; /* what this communication step wrote over, for the case that it fails */
    long long taken_before;      /* this communication step */
    char message[MESSAGE]; /* why the last call failed */
} Motion;

#include "slave.c"

static void begin(Motion *m) {
    memset(m, 0, sizeof *m);
    memcpy(m->value, START, sizeof m->value);
    m->contact = CONTACT;
    m->constants_due = m->outputs_due = 1;
}

static void renew_constants(Motion *m) {
    const double *arg[N_ARG] = {m->value + PARAMETERS, &m->contact};
    double *res[N_RES] = {m->constant, m->delay}, w[N_W], input = 0, output = 0;
    casadi_int iw[N_IW];
    if (!m->constants_due) return;
    constants(arg, res, iw, w, 0);
    for (int i = 0; i < N_INPUTS; i++) input = fmax(input, m->delay[i]);
    for (int i = 0; i < N_OUTPUTS; i++) output = fmax(output, m->delay[N_INPUTS + i]);
    m->longest = input + output;
    m->constants_due = 0;
}

/* the step taken that holds time t, the oldest known if none does; `side` says which of two that meet at t */
static const Taken *back(const Motion *m, double t, int side) {
    long long k = m->taken - 1, first = m->taken > N_TAKEN ? m->taken - N_TAKEN : 0;
    for (; k > first; k--) {
        const Taken *own = &m->step[k % (N_TAKEN + 1)];
        if (own->time <= t + side * 1e-9 * own->span) break;
    }
    return &m->step[(k < 0 ? 0 : k) % (N_TAKEN + 1)];
}

/* inputs as they act at time t; before the beginning they held their first value */
static void look(const Motion *m, double t, int side, double *u) {
    for (int i = 0; i < N_INPUTS; i++) {
        double at = t - m->delay[i], now = m->value[TIME];
        u[i] = m->value[INPUTS + i] + m->slope[i] * fmax(at - now, 0);
        if (!N_TAKEN || !m->taken || at + side * 1e-9 / m->value[STEPS_PER_SECOND] >= now) continue;
        const Taken *own = back(m, at, side);
        u[i] = own->u[i] + own->slope[i] * fmax(at - own->time, 0);
    }
}

static void rates(const Motion *m, double t, int side, const double *x, double *xdot) {
    double u[N_INPUTS + 1], *res[N_RES] = {xdot}, w[N_W];
    casadi_int iw[N_IW];
    look(m, t, side, u);
    const double *arg[N_ARG] = {x, u, m->constant};
    field(arg, res, iw, w, 0);
}

/* readings y of what was at time t, as read now */
static void read_at(const Motion *m, double t, const double *x, double *y) {
    double u[N_INPUTS + 1], *res[N_RES] = {y}, w[N_W];
    casadi_int iw[N_IW];
    look(m, t, 1, u);
    const double *arg[N_ARG] = {x, u, m->constant, m->value + TIME};
    reading(arg, res, iw, w, 0);
}

/* The state at an earlier time t: cubic Hermite within a step; before the first the angles ran with their speeds. */
static void state_at(const Motion *m, double t, double *x) {
    const double *end = m->value + STATES;
    const Taken *own = back(m, t, 1);
    if (!m->taken || t <= own->time) {
        const double *first = m->taken ? own->x : end;
        double earlier = (m->taken ? own->time : m->value[TIME]) - t;
        for (int i = 0; i < N_STATES; i++) x[i] = first[i] - (SPEED[i] < 0 ? 0 : earlier * first[SPEED[i]]);
        return;
    }
    if (own != &m->step[(m->taken - 1) % (N_TAKEN + 1)]) end = (own == m->step + N_TAKEN ? m->step : own + 1)->x;
    double h = own->span, z = (t - own->time) / h;
    double a = (1 + 2 * z) * (1 - z) * (1 - z), b = h * z * (1 - z) * (1 - z), c = z * z * (3 - 2 * z), d = h * z * z * (z - 1);
    for (int i = 0; i < N_STATES; i++) x[i] = a * own->x[i] + b * own->rate[i] + c * end[i] + d * own->end_rate[i];
}

static void renew_outputs(Motion *m) {
    if (!m->outputs_due) return;
    renew_constants(m);
    read_at(m, m->value[TIME], m->value + STATES, m->value + OUTPUTS);
    for (int j = 0; N_TAKEN && j < N_OUTPUTS; j++)
        if (m->delay[N_INPUTS + j] > 0) {
            double x[N_STATES], y[N_OUTPUTS + 1], t = m->value[TIME] - m->delay[N_INPUTS + j];
            state_at(m, t, x);
            read_at(m, t, x, y);
            m->value[OUTPUTS + j] = y[j];
        }
    m->outputs_due = 0;
}

static int get(Motion *m, unsigned reference, double *value) {
    if (!known(m, reference)) return 0;
    if (reference >= OUTPUTS && reference < PARAMETERS) renew_outputs(m);
    *value = m->value[reference];
    return 1;
}

/* states may be set before the motion begins, inputs and parameters at any time */
static int set(Motion *m, unsigned reference, double value) {
    if (!known(m, reference)) return 0;
    const char *name = NAME[reference];
    if (!isfinite(value)) return fail(m, "%s: the value is not a finite number", name);
    if (reference == TIME || (reference >= OUTPUTS && reference < PARAMETERS))
        return fail(m, "%s: is computed and cannot be set; inputs, parameters and start states can", name);
    if (reference >= STATES && m->phase >= STEPPING)
        return fail(m, "%s: a state cannot be set once the motion has begun; reset first", name);
    if (reference >= PARAMETERS && reference < STATES) {
        double low = LOWER[reference - PARAMETERS], high = UPPER[reference - PARAMETERS];
        if (value < low || value > high || (value == 0 && NOT_ZERO[reference - PARAMETERS]))
            return fail(m, "%s: %g is not possible; %g ... %g%s is needed", name, value, low, high,
                        NOT_ZERO[reference - PARAMETERS] ? ", but not 0," : "");
        m->constants_due = 1;
    }
    m->outputs_due = 1;
    m->value[reference] = value;
    return 1;
}

/* keep what an internal step begins with, if delays look back; 0 where they look back too far */
static int keep(Motion *m, double t, double h, const double *x) {
    if (!N_TAKEN) return 1;
    long long place = m->taken % (N_TAKEN + 1);
    Taken *own = &m->step[place];
    if (m->taken - m->taken_before <= N_TAKEN) m->replaced[place] = *own;
    m->taken++;
    own->time = t, own->span = h;
    memcpy(own->x, x, sizeof own->x);
    for (int i = 0; i < N_INPUTS; i++) {
        own->u[i] = m->value[INPUTS + i] + m->slope[i] * (t - m->value[TIME]);
        own->slope[i] = m->slope[i];
    }
    return m->taken <= N_TAKEN || back(m, -HUGE_VAL, 0)->time <= t - m->longest ||
           fail(m, "delays of %g s look back over more than the %d internal steps that are kept; take longer steps",
                m->longest, N_TAKEN);
}

/* steps of h from the time t on */
static int runge_kutta(Motion *m, double begin, int steps, double h, double *x) {
    double y[N_STATES], k1[N_STATES], k2[N_STATES], k3[N_STATES], k4[N_STATES];
    for (int j = 0; j < steps; j++) {
        double t = begin + j * h;
        if (!keep(m, t, h, x)) return 0;
        rates(m, t, 1, x, k1);
        for (int i = 0; i < N_STATES; i++) y[i] = x[i] + h / 2 * k1[i];
        rates(m, t + h / 2, 0, y, k2);
        for (int i = 0; i < N_STATES; i++) y[i] = x[i] + h / 2 * k2[i];
        rates(m, t + h / 2, 0, y, k3);
        for (int i = 0; i < N_STATES; i++) y[i] = x[i] + h * k3[i];
        rates(m, t + h, -1, y, k4);
        for (int i = 0; i < N_STATES; i++) x[i] += h / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i]);
        if (!N_TAKEN) continue;
        Taken *own = &m->step[(m->taken - 1) % (N_TAKEN + 1)];
        memcpy(own->rate, k1, sizeof k1);
        rates(m, t + h, -1, x, own->end_rate);
    }
    for (int i = 0; i < N_STATES; i++)
        if (!isfinite(x[i]))
            return fail(m, "%s: is not finite after %g s; raise simulation.steps_per_second or check the parameters",
                        NAME[STATES + i], begin + steps * h);
    return 1;
}

/* steps that clutches need over the next seconds, at least those wanted */
static double paced(const Motion *m, double t, double seconds, double wanted, const double *x) {
#if HAS_PACE
    double u[N_INPUTS + 1], most = 0, *res[N_RES] = {&most}, w[N_W];
    casadi_int iw[N_IW];
    look(m, t, 1, u);
    const double *arg[N_ARG] = {x, u, m->constant, &seconds};
    pace(arg, res, iw, w, 0);
    return fmax(wanted, ceil(seconds * most));
#else
    (void)m, (void)t, (void)seconds, (void)x;
    return wanted;
#endif
}

/* forget the internal steps of this communication step: the ring is as it was before */
static void step_back(Motion *m) {
    long long written = m->taken - m->taken_before;
    if (written > N_TAKEN + 1) written = N_TAKEN + 1;
    for (long long k = m->taken_before; k < m->taken_before + written; k++)
        m->step[k % (N_TAKEN + 1)] = m->replaced[k % (N_TAKEN + 1)];
    m->taken = m->taken_before;
}

/* One communication step; the motion stays where it was if it fails. */
static int advance(Motion *m, double span) {
    double x[N_STATES], wanted = ceil(span * m->value[STEPS_PER_SECOND] - 1e-9);
    if (!isfinite(span) || span < 0) return fail(m, "a communication step of %g s is not possible", span);
    if (span == 0) return 1;
    if (wanted > MOST_STEPS) return fail(m, "a communication step of %g s would take %.3g internal steps", span, wanted);
    int steps = wanted < 1 ? 1 : (int)wanted;
    m->taken_before = m->taken;
    if (HAS_CONTACT && m->contact != span / steps) m->contact = span / steps, m->constants_due = 1;
    renew_constants(m);
    memcpy(x, m->value + STATES, sizeof x);
    int sections = HAS_PACE ? (int)ceil(span / SECTION - 1e-9) : 1;
    if (sections < 1) sections = 1;
    for (int i = 0; i < sections; i++) {
        double t = m->value[TIME] + i * (span / sections), own = paced(m, t, span / sections, ceil((double)steps / sections), x);
        if (!(own <= MOST_STEPS))
            return step_back(m), fail(m, "the clutches would take %.3g internal steps in %g s", own, span / sections);
        if (!runge_kutta(m, t, (int)own, span / sections / own, x)) return step_back(m), 0;
    }
    memcpy(m->value + STATES, x, sizeof x);
    for (int i = 0; i < N_INPUTS; i++) m->value[INPUTS + i] += m->slope[i] * span, m->slope[i] = 0;
    m->value[TIME] += span;
    m->outputs_due = 1;
    return 1;
}
