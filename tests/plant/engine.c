/* Torsional chain with hard lash and set-valued friction, integrated by events.
 *
 * Between events the set of closed lashes and sticking inertias is frozen and the smooth equations are advanced by
 * classical Runge-Kutta of order four; a step that would cross an event is cut at the event by bisection, the set is
 * changed there, and the rest of the step follows. A sticking inertia has speed zero to the bit.
 *
 * State: angle[n], speed[n], dahl[s] (torque of the parallel Dahl element), spring[s] (twist of a spring whose shaft
 * has a damper in series), lagged[u] (input torque behind a first-order lag).
 */
#include <math.h>
#include <string.h>

#define LARGEST 96
#define CURVE_POINTS 33

typedef struct {
    int n, s, u, samples, substeps, rows_per_sample, jump_sample, disturbed;
    double dt, disturbance_amplitude, disturbance_frequency, disturbance_phase, warm_from;
    /* inertias; J, drag (and k, c of shafts) hold a second block that holds from jump_sample on */
    const double *J, *drag, *friction, *friction_reverse, *breakaway, *breakaway_reverse, *stribeck_speed;
    const double *quadratic, *constant, *ripple_order, *ripple_amplitude, *ripple_phase;
    const double *ripple_follows;   /* number of the inertia whose angle the ripple is over */
    const double *place_period, *place_amplitude, *place_phase;   /* resisting torque that repeats over the angle */
    const double *drag_change, *drag_warm;   /* change towards which a value goes from warm_from on, time constant */
    const double *curve_over, *curve_count, *curve_at, *curve_torque;   /* over 1: speed, 2: angle; CURVE_POINTS a row */
    const double *imposed;   /* 1: the inertia has the speed of the input on it, whatever torque that takes */
    /* shafts */
    const int *first, *second;
    const double *ratio, *k, *c, *gap, *cubic, *dahl_torque, *dahl_angle, *series_damper, *wave_amplitude, *wave_order;
    const double *lost_driven, *lost_driving;   /* shares of the torque that the second end loses */
    const double *k_change, *k_warm, *c_change, *c_warm;
    const double *twist_count, *twist_at, *twist_torque;   /* torque besides the spring; CURVE_POINTS a row */
    const double *slip_stiffness, *slip_peak, *slip_shape;   /* a tyre on the road, which is the second end */
    /* inputs */
    const int *on, *controlled;
    const double *gain_change, *gain_warm, *delay, *lag, *factor, *limit, *offset;
    const double *gain_p, *gain_i, *torque_limit, *reference, *feedback_noise;
    double *input;   /* samples x u: feed-forward before, recorded torque after */
    const double *start;   /* angle[n], speed[n] */
    double *output;  /* rows x (3n + s): angle, speed, acceleration, torque */
} Plant;

typedef struct { int slide[16]; int contact[16]; } Modes;   /* slide 0 = stick; contact -1, 0, 1 */

static int block(const Plant *p, double t) { return t >= p->jump_sample * p->dt - 1e-12; }
static int has_friction(const Plant *p, int i) { return p->friction[i] > 0 || p->friction_reverse[i] > 0; }

static double warm(const Plant *p, double change, double constant, double t) {
    return change == 0 || t <= p->warm_from ? 1 : 1 - change * expm1(-(t - p->warm_from) / constant);
}

/* a bed that is stepped takes its inputs from what arrived so far instead */
#ifdef INPUT_NOW
static double INPUT_NOW(const Plant *p, int j, double t);
#else
#define INPUT_NOW recorded
#endif

static double recorded(const Plant *p, int j, double t) {
    double x = (t - p->delay[j]) / p->dt;
    int k = (int)floor(x);
    double a, b;
    if (x <= 0) { k = 0; x = 0; }
    if (k > p->samples - 2) k = p->samples - 2;
    if (x > p->samples - 1) x = p->samples - 1;
    a = p->input[k * p->u + j];
    b = p->input[(k + 1) * p->u + j];
    a = p->factor[j] * warm(p, p->gain_change[j], p->gain_warm[j], t) * (a + (b - a) * (x - k)) + p->offset[j];
    if (a > p->limit[j]) a = p->limit[j];
    if (a < -p->limit[j]) a = -p->limit[j];
    return a;
}

/* slope of a recorded input, linear between samples */
static double recorded_slope(const Plant *p, int j, double t) {
    int k = (int)floor((t - p->delay[j]) / p->dt);
    if (k < 0 || k > p->samples - 2) return 0;
    return p->factor[j] * (p->input[(k + 1) * p->u + j] - p->input[k * p->u + j]) / p->dt;
}

/* twist beyond the free play and the pressing torque there; both must be positive for contact on that side */
static double pressing(const Plant *p, double t, int j, const double *y, int b, int side, double *torque) {
    const double *q = y, *w = y + p->n;
    double twist = q[p->first[j]] / p->ratio[j] - q[p->second[j]];
    double rate = w[p->first[j]] / p->ratio[j] - w[p->second[j]];
    double over = side * twist - p->gap[j] / 2;
    double k = p->k[b * p->s + j] * warm(p, p->k_change[j], p->k_warm[j], t);
    double push = k * over + p->c[b * p->s + j] * warm(p, p->c_change[j], p->c_warm[j], t) * side * rate;
    if (torque) *torque = side * push;
    return over < push / k ? over : push / k;
}

/* linear between its points, constant beyond them */
static double curve(const double *at, const double *torque, int count, double x) {
    int k = 1;
    if (x <= at[0]) return torque[0];
    if (x >= at[count - 1]) return torque[count - 1];
    while (x > at[k]) k++;
    return torque[k - 1] + (torque[k] - torque[k - 1]) * (x - at[k - 1]) / (at[k] - at[k - 1]);
}

static double shaft_torque(const Plant *p, double t, int j, const double *y, const Modes *m, int b, double *dspring) {
    const double *q = y, *w = y + p->n, *dahl = y + 2 * p->n, *spring = dahl + p->s;
    double twist = q[p->first[j]] / p->ratio[j] - q[p->second[j]];
    double rate = w[p->first[j]] / p->ratio[j] - w[p->second[j]];
    double k = p->k[b * p->s + j] * warm(p, p->k_change[j], p->k_warm[j], t);
    double c = p->c[b * p->s + j] * warm(p, p->c_change[j], p->c_warm[j], t), torque = 0;
    *dspring = 0;
    if (p->slip_stiffness[j] > 0) {   /* carcass in series with a contact patch after the Magic Formula */
        double per_torque = fabs(w[p->second[j]]) / p->slip_stiffness[j], most = p->slip_shape[j] * p->slip_peak[j];
        *dspring = (rate - per_torque * k * spring[j]) / (1 + per_torque * c);
        torque = p->slip_peak[j] * sin(p->slip_shape[j] * atan((k * spring[j] + c * *dspring) / most));
    } else if (p->series_damper[j] > 0) {
        *dspring = (p->series_damper[j] * rate - k * spring[j]) / (p->series_damper[j] + c);
        torque = k * spring[j] + c * *dspring;
    } else if (p->gap[j] > 0) {
        if (m->contact[j]) pressing(p, t, j, y, b, m->contact[j], &torque);
    } else {
        if (p->wave_amplitude[j] != 0) k *= 1 + p->wave_amplitude[j] * sin(p->wave_order[j] * q[p->second[j]]);
        torque = k * twist + c * rate + p->cubic[j] * twist * twist * twist;
    }
    if (p->twist_count[j] > 0) {
        int row = j * CURVE_POINTS;
        torque += curve(p->twist_at + row, p->twist_torque + row, (int)p->twist_count[j], twist);
    }
    return torque + (p->dahl_torque[j] > 0 ? dahl[j] : 0);
}

/* derivative of the state; load[i] is the torque on inertia i before dry friction */
static void field(const Plant *p, double t, const double *y, const Modes *m, int b, double *dy, double *torque,
                  double *load) {
    const double *q = y, *w = y + p->n, *dahl = y + 2 * p->n, *lagged = dahl + 2 * p->s;
    double own_load[16], own_torque[16];
    if (!load) load = own_load;
    if (!torque) torque = own_torque;
    for (int i = 0; i < p->n; i++) {
        load[i] = -p->drag[b * p->n + i] * warm(p, p->drag_change[i], p->drag_warm[i], t) * w[i] - p->quadratic[i] * w[i] * fabs(w[i]) - p->constant[i];
        if (p->ripple_amplitude[i] != 0)
            load[i] += p->ripple_amplitude[i] * sin(p->ripple_order[i] * q[(int)p->ripple_follows[i]] + p->ripple_phase[i]);
    }
    for (int i = 0; i < p->n; i++)
        if (p->place_amplitude[i] != 0)
            load[i] -= p->place_amplitude[i] * sin(6.283185307179586 * q[i] / p->place_period[i] + p->place_phase[i]);
    for (int i = 0; i < p->n; i++)
        if (p->curve_over[i] > 0) {
            int row = i * CURVE_POINTS;
            load[i] += curve(p->curve_at + row, p->curve_torque + row, (int)p->curve_count[i],
                             p->curve_over[i] == 1 ? w[i] : q[i]);
        }
    if (p->disturbed >= 0)
        load[p->disturbed] += p->disturbance_amplitude * sin(p->disturbance_frequency * t + p->disturbance_phase);
    for (int j = 0; j < p->u; j++) {
        double now = INPUT_NOW(p, j, t);
        dy[2 * p->n + 2 * p->s + j] = p->lag[j] > 0 ? (now - lagged[j]) / p->lag[j] : 0;
        load[p->on[j]] += p->lag[j] > 0 ? lagged[j] : now;
    }
    for (int j = 0; j < p->s; j++) {
        double rate = w[p->first[j]] / p->ratio[j] - w[p->second[j]];
        torque[j] = shaft_torque(p, t, j, y, m, b, &dy[2 * p->n + p->s + j]);
        load[p->first[j]] -= torque[j] / p->ratio[j];
        load[p->second[j]] += torque[j];
        if (p->lost_driven[j] > 0 || p->lost_driving[j] > 0) {
            double power = torque[j] * w[p->second[j]];
            double lost = fabs(torque[j]) * (power > 0 ? p->lost_driven[j] : p->lost_driving[j]);
            load[p->second[j]] -= w[p->second[j]] > 0 ? lost : w[p->second[j]] < 0 ? -lost : 0;
        }
        dy[2 * p->n + j] = p->dahl_torque[j] > 0
            ? (rate - fabs(rate) * dahl[j] / p->dahl_torque[j]) * p->dahl_torque[j] / p->dahl_angle[j] : 0;
    }
    for (int i = 0; i < p->n; i++) {
        double dry = 0;
        dy[i] = w[i];
        if (has_friction(p, i)) {
            int side = m->slide[i];
            if (side == 0) { dy[i] = 0; dy[p->n + i] = 0; continue; }
            dry = side > 0 ? p->friction[i] : p->friction_reverse[i];
            if (p->stribeck_speed[i] > 0) {
                double x = w[i] / p->stribeck_speed[i];
                dry += ((side > 0 ? p->breakaway[i] : p->breakaway_reverse[i]) - dry) * exp(-x * x);
            }
            dry *= side;
        }
        dy[p->n + i] = (load[i] - dry) / p->J[b * p->n + i];
    }
    for (int j = 0; j < p->u; j++)
        if (p->imposed[p->on[j]] > 0) dy[p->n + p->on[j]] = recorded_slope(p, j, t);
}

static void runge_kutta(const Plant *p, double t, const double *y, const Modes *m, int b, double h, double *z) {
    double a[LARGEST], d[LARGEST], e[LARGEST], f[LARGEST], x[LARGEST];
    int size = 2 * p->n + 2 * p->s + p->u;
    field(p, t, y, m, b, a, 0, 0);
    for (int i = 0; i < size; i++) x[i] = y[i] + h / 2 * a[i];
    field(p, t + h / 2, x, m, b, d, 0, 0);
    for (int i = 0; i < size; i++) x[i] = y[i] + h / 2 * d[i];
    field(p, t + h / 2, x, m, b, e, 0, 0);
    for (int i = 0; i < size; i++) x[i] = y[i] + h * e[i];
    field(p, t + h, x, m, b, f, 0, 0);
    for (int i = 0; i < size; i++) z[i] = y[i] + h / 6 * (a[i] + 2 * d[i] + 2 * e[i] + f[i]);
}

static int stuck_or_sliding(const Plant *p, int i, double load) {
    return load > p->breakaway[i] ? 1 : load < -p->breakaway_reverse[i] ? -1 : 0;
}

static int contact_now(const Plant *p, double t, int j, const double *y, int b) {
    return pressing(p, t, j, y, b, 1, 0) > 0 ? 1 : pressing(p, t, j, y, b, -1, 0) > 0 ? -1 : 0;
}

/* is the frozen set wrong at y? with change: set it right there */
static int event(const Plant *p, double t, double *y, Modes *m, int b, int change) {
    double dy[LARGEST], load[16];
    int found = 0, any = 0;
    for (int j = 0; j < p->s; j++)
        if (p->gap[j] > 0) {
            int now = contact_now(p, t, j, y, b);
            if (now != m->contact[j]) { found = 1; if (change) m->contact[j] = now; }
        }
    for (int i = 0; i < p->n; i++) any |= has_friction(p, i);
    if (!any) return found;
    if (change)
        for (int i = 0; i < p->n; i++)
            if (has_friction(p, i) && m->slide[i] * y[p->n + i] < 0) { y[p->n + i] = 0; m->slide[i] = 0; }
    field(p, t, y, m, b, dy, 0, load);
    for (int i = 0; i < p->n; i++) {
        if (!has_friction(p, i)) continue;
        if (m->slide[i] * y[p->n + i] < 0) found = 1;
        if (m->slide[i] == 0) {
            int now = stuck_or_sliding(p, i, load[i]);
            if (now) { found = 1; if (change) m->slide[i] = now; }
        }
    }
    return found;
}

static void advance(const Plant *p, double t, double *y, Modes *m, int b, double h) {
    double z[LARGEST];
    int size = 2 * p->n + 2 * p->s + p->u;
    double left = h;
    for (int tries = 0; left > 0; tries++) {
        double low = 0, high = left;
        runge_kutta(p, t, y, m, b, left, z);
        if (tries < 60 && event(p, t + left, z, m, b, 0)) {
            for (int k = 0; k < 24; k++) {
                double middle = (low + high) / 2;
                runge_kutta(p, t, y, m, b, middle, z);
                if (event(p, t + middle, z, m, b, 0)) high = middle; else low = middle;
            }
            runge_kutta(p, t, y, m, b, high, z);
            event(p, t + high, z, m, b, 1);
        } else if (tries >= 60) event(p, t + left, z, m, b, 1);
        memcpy(y, z, size * sizeof(double));
        t += high;
        left -= high;
        if (left < 1e-12 * h) left = 0;
    }
    for (int j = 0; j < p->u; j++)   /* rounding puts the end of a step before or behind the recording's kink */
        if (p->imposed[p->on[j]] > 0) y[p->n + p->on[j]] = INPUT_NOW(p, j, t);
}

static int write_row(const Plant *p, double t, const double *y, const Modes *m, int b, double *row) {
    double dy[LARGEST], torque[16];
    field(p, t, y, m, b, dy, torque, 0);
    for (int i = 0; i < 2 * p->n; i++) row[i] = y[i];
    for (int i = 0; i < p->n; i++) row[2 * p->n + i] = dy[p->n + i];
    for (int j = 0; j < p->s; j++) row[3 * p->n + j] = torque[j];
    for (int i = 0; i < 3 * p->n + p->s; i++) if (!isfinite(row[i])) return 0;
    return 1;
}

/* 0: done; otherwise the number of the sample (from 1) at which a value was not finite */
int run(const Plant *p) {
    double y[LARGEST] = {0}, integral[16] = {0};
    Modes m = {{0}, {0}};
    double h = p->dt / p->substeps;
    int every = p->substeps / p->rows_per_sample, width = 3 * p->n + p->s, row = 0;
    memcpy(y, p->start, 2 * p->n * sizeof(double));
    for (int j = 0; j < p->s; j++)
        y[2 * p->n + p->s + j] = y[p->first[j]] / p->ratio[j] - y[p->second[j]];
    for (int i = 0; i < p->n; i++) m.slide[i] = (y[p->n + i] > 0) - (y[p->n + i] < 0);
    for (int j = 0; j < p->u; j++) y[2 * p->n + 2 * p->s + j] = INPUT_NOW(p, j, 0);
    event(p, 0, y, &m, block(p, 0), 1);
    for (int k = 0; k < p->samples; k++) {
        int b = block(p, k * p->dt);
        for (int j = 0; j < p->u; j++)   /* a controller sees sample k and commands sample k + 1 */
            if (p->controlled[j] && k + 1 < p->samples) {
                double seen = y[p->n + p->on[j]] + p->feedback_noise[k * p->u + j];
                double error = p->reference[k * p->u + j] - seen;
                double *command = &p->input[(k + 1) * p->u + j];
                double wanted = *command + p->gain_p[j] * error + p->gain_i[j] * (integral[j] + error * p->dt);
                if (fabs(wanted) < p->torque_limit[j]) integral[j] += error * p->dt;
                else wanted = wanted > 0 ? p->torque_limit[j] : -p->torque_limit[j];
                *command = wanted;
            }
        for (int l = 0; l < p->substeps; l++) {
            double t = (k + (double)l / p->substeps) * p->dt;
            if (l % every == 0) {
                if (!write_row(p, t, y, &m, b, p->output + (size_t)row * width)) return k + 1;
                row++;
            }
            if (k == p->samples - 1) break;
            advance(p, t, y, &m, b, h);
        }
    }
    return 0;
}
