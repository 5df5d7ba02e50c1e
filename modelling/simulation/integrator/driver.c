/* Classical Runge-Kutta of order four around two generated functions, with forward sensitivities, and readings that
 * may be taken between the steps (delays). Compiled once for all models, which hand in
 *
 *   field(x, u, c)      -> xdot (, A, B, P)      derivatives by x, u, p: only if there are columns of sensitivity
 *   reading(x, u, c, t) -> y    (, C, D, Q)
 *
 * c are constants of the parameters. Letters as everywhere: b batch, t samples, x states, u inputs, y sensors,
 * p parameters; s columns of sensitivity. All arrays row-major except the sparse derivatives (compressed columns).
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef long long integer;

typedef struct { const integer *start, *row; } Pattern;
typedef int (*Function)(const double **arg, double **res, integer *iw, double *w, int memory);

typedef struct {
    Function field, reading;
    integer first, batch, samples, states, coordinates, inputs, sensors, columns, groups, constants, parameters, sz_iw, sz_w;
    double steps_per_second;     /* rows first … batch - 1 are run */
    const double *time;          /* (t) */
    const double *input;         /* (t, u) */
    const double *constant;      /* (b, c) */
    const double *start;         /* (b, x) */
    const double *input_delay;   /* (b, u) */
    const double *group_delay;   /* (b, g): delay of a group of sensors */
    const integer *group;        /* (y): which group a sensor belongs to */
    double *state;               /* (b, t, x), or null */
    double *out;                 /* (b, t, y), or null */
    integer *failed;             /* (b, 2): first sample and state that is not finite, or -1 */
    /* sensitivity */
    const integer *selected;     /* (s): parameter of the column, or -1 */
    const double *start_slope;   /* (x, s) */
    const double *input_delay_slope;   /* (u, s): derivative of the delays */
    const double *sensor_delay_slope;  /* (y, s) */
    Pattern A, B, P, C, D, Q;
    double *slope;               /* (b, t, y, s) */
} Run;

typedef struct {
    const Run *r;
    integer size;                /* x·(1 + s) */
    const double *constant, *delay;
    double *u, *du, *rise, *y, *A, *B, *P, *C, *D, *Q, *w;
    integer *iw, *hint;
    double looked;               /* the time that u and du are of, or NaN */
} Work;

/* inputs and their slopes at a time: linear between samples, held before the first and after the last */
static void look(Work *k, double t) {
    const Run *r = k->r;
    const double *time = r->time;
    integer last = r->samples - 1, n = r->inputs;
    if (t == k->looked) return;
    k->looked = t;
    for (integer i = 0; i < n; i++) {
        double at = t - k->delay[i];
        integer j = k->hint[i];
        if (at <= time[0]) { k->u[i] = r->input[i]; k->du[i] = 0; continue; }
        if (at >= time[last]) { k->u[i] = r->input[last * n + i]; k->du[i] = 0; continue; }
        while (at > time[j + 1]) j++;
        while (at < time[j]) j--;
        const double *low = r->input + j * n + i;
        if (j != k->hint[i]) k->rise[i] = (low[n] - low[0]) / (time[j + 1] - time[j]), k->hint[i] = j;
        k->du[i] = k->rise[i];
        k->u[i] = low[0] + k->rise[i] * (at - time[j]);
    }
}

/* out (m, s) += M (m, x) · S (x, s) */
static void add_product(const Pattern *M, const double *value, integer columns, const double *S, integer s, double *out) {
    for (integer j = 0; j < columns; j++)
        for (integer e = M->start[j]; e < M->start[j + 1]; e++) {
            double v = value[e];
            const double *from = S + j * s;
            double *to = out + M->row[e] * s;
            for (integer c = 0; c < s; c++) to[c] += v * from[c];
        }
}

/* what the parameters do directly and, through the input delays, later */
static void add_direct(Work *k, const Pattern *P, const double *p, const Pattern *B, const double *b, double *out) {
    const Run *r = k->r;
    integer s = r->columns;
    for (integer c = 0; c < s; c++) {
        integer j = r->selected[c];
        if (j >= 0)
            for (integer e = P->start[j]; e < P->start[j + 1]; e++) out[P->row[e] * s + c] += p[e];
        for (integer i = 0; i < r->inputs; i++) {
            double later = -k->du[i] * r->input_delay_slope[i * s + c];
            if (later != 0)
                for (integer e = B->start[i]; e < B->start[i + 1]; e++) out[B->row[e] * s + c] += b[e] * later;
        }
    }
}

static void flow(Work *k, double t, const double *X, double *dX) {
    const Run *r = k->r;
    integer x = r->states, s = r->columns;
    look(k, t);
    const double *arg[3] = {X, k->u, k->constant};
    double *res[4] = {dX, k->A, k->B, k->P};
    r->field(arg, res, k->iw, k->w, 0);
    if (!s) return;
    memset(dX + x, 0, sizeof(double) * x * s);
    add_product(&r->A, k->A, x, X + x, s, dX + x);
    add_direct(k, &r->P, k->P, &r->B, k->B, dX + x);
}

/* readings of one group of sensors, of sample number `sample`, from the state X that flows with dX at time t */
static void take(Work *k, integer b, integer sample, integer g, double t, const double *X, const double *dX) {
    const Run *r = k->r;
    integer m = r->sensors, at = (b * r->samples + sample) * m;
    look(k, t);
    const double *arg[4] = {X, k->u, k->constant, r->time + sample};
    double *res[4] = {k->y, k->C, k->D, k->Q};
    r->reading(arg, res, k->iw, k->w, 0);
    for (integer j = 0; j < m; j++)
        if (r->group[j] == g) r->out[at + j] = k->y[j];
    integer x = r->states, s = r->columns;
    if (!s) return;
    double *slope = k->y + m, *rate = slope + m * s;
    memset(slope, 0, sizeof(double) * m * (s + 1));
    add_product(&r->C, k->C, x, X + x, s, slope);
    add_direct(k, &r->Q, k->Q, &r->D, k->D, slope);
    if (g > 0) {
        add_product(&r->C, k->C, x, dX, 1, rate);
        add_product(&r->D, k->D, r->inputs, k->du, 1, rate);
        for (integer j = 0; j < m; j++)
            for (integer c = 0; c < s; c++) slope[j * s + c] -= rate[j] * r->sensor_delay_slope[j * s + c];
    }
    for (integer j = 0; j < m; j++)
        if (r->group[j] == g) memcpy(r->slope + (at + j) * s, slope + j * s, sizeof(double) * s);
}

/* before the recording the system moved as it did at its start: angles run back with their speeds */
static void before(const Work *k, double earlier, const double *X, double *Y, double *dY) {
    const Run *r = k->r;
    integer n = r->coordinates, s = r->columns, x = r->states;
    memcpy(Y, X, sizeof(double) * k->size);
    memset(dY, 0, sizeof(double) * k->size);
    for (integer i = 0; i < n; i++) {
        Y[i] -= earlier * X[n + i];
        dY[i] = X[n + i];
        for (integer c = 0; c < s; c++) Y[x + i * s + c] -= earlier * X[x + (n + i) * s + c];
    }
}

/* cubic Hermite between two nodes h apart, at the fraction z, with its time derivative */
static void between(integer size, double h, double z, const double *X, const double *dX, const double *Y,
                    const double *dY, double *Z, double *dZ) {
    double a = (1 + 2 * z) * (1 - z) * (1 - z), b = h * z * (1 - z) * (1 - z), c = z * z * (3 - 2 * z), d = h * z * z * (z - 1);
    double e = 6 * z * (z - 1) / h, f = (1 - z) * (1 - 3 * z), g = z * (3 * z - 2);
    for (integer i = 0; i < size; i++) {
        Z[i] = a * X[i] + b * dX[i] + c * Y[i] + d * dY[i];
        dZ[i] = e * (X[i] - Y[i]) + f * dX[i] + g * dY[i];
    }
}

static integer not_finite(const double *X, integer size) {
    for (integer i = 0; i < size; i++)
        if (!isfinite(X[i])) return i;
    return -1;
}

int run(const Run *r) {
    integer x = r->states, s = r->columns, size = x * (1 + s), m = r->sensors, n = r->inputs, T = r->samples;
    Work k = {.r = r, .size = size};
    integer reals = 9 * size + 3 * n + m * (s + 2) + r->sz_w + 8;
    integer sizes[6] = {0};
    if (s) {
        integer p = r->parameters;
        const integer ends[6] = {r->A.start[x], r->B.start[n], r->P.start[p], r->C.start[x], r->D.start[n], r->Q.start[p]};
        for (int i = 0; i < 6; i++) reals += sizes[i] = ends[i];
    }
    double *memory = malloc(sizeof(double) * reals);
    integer *counters = calloc(r->sz_iw + n + r->groups + 1, sizeof(integer));
    if (!memory || !counters) { free(memory); free(counters); return 1; }
    double *X = memory, *Y = X + size, *K1 = Y + size, *K2 = K1 + size, *K3 = K2 + size, *K4 = K3 + size, *Z = K4 + size;
    double *dZ = Z + size, *next = dZ + size;
    k.u = next + size, k.du = k.u + n, k.rise = k.du + n, k.y = k.rise + n, k.w = k.y + m * (s + 2);
    k.A = k.w + r->sz_w, k.B = k.A + sizes[0], k.P = k.B + sizes[1];
    k.C = k.P + sizes[2], k.D = k.C + sizes[3], k.Q = k.D + sizes[4];
    k.iw = counters, k.hint = counters + r->sz_iw;
    integer *due = k.hint + n;
    for (integer b = r->first; b < r->batch; b++) {
        const double *delay = r->group_delay + b * r->groups;
        k.constant = r->constant + b * r->constants, k.delay = r->input_delay + b * n;
        memcpy(X, r->start + b * x, sizeof(double) * x);
        if (s) memcpy(X + x, r->start_slope, sizeof(double) * x * s);
        if (r->state) memcpy(r->state + b * T * x, X, sizeof(double) * x);
        memset(due, 0, sizeof(integer) * r->groups);
        for (integer i = 0; i < n; i++) k.hint[i] = -1;
        k.looked = NAN;
        r->failed[2 * b] = r->failed[2 * b + 1] = -1;
        flow(&k, r->time[0], X, K1);
        for (integer g = 0; g < r->groups && r->out; g++)
            for (; due[g] < T && r->time[due[g]] - delay[g] <= r->time[0]; due[g]++) {
                double earlier = r->time[0] - (r->time[due[g]] - delay[g]);
                before(&k, earlier, X, Z, dZ);
                take(&k, b, due[g], g, r->time[0] - earlier, Z, dZ);
            }
        for (integer j = 0; j + 1 < T; j++) {
            double from = r->time[j], span = r->time[j + 1] - from;
            integer steps = (integer)ceil(span * r->steps_per_second - 1e-9);
            if (steps < 1) steps = 1;
            double h = span / steps;
            for (integer i = 0; i < steps; i++) {
                double ta = from + i * h, tb = i + 1 == steps ? r->time[j + 1] : from + (i + 1) * h;
                for (integer e = 0; e < size; e++) Y[e] = X[e] + h / 2 * K1[e];
                flow(&k, ta + h / 2, Y, K2);
                for (integer e = 0; e < size; e++) Y[e] = X[e] + h / 2 * K2[e];
                flow(&k, ta + h / 2, Y, K3);
                for (integer e = 0; e < size; e++) Y[e] = X[e] + h * K3[e];
                flow(&k, tb, Y, K4);
                for (integer e = 0; e < size; e++) next[e] = X[e] + h / 6 * (K1[e] + 2 * (K2[e] + K3[e]) + K4[e]);
                flow(&k, tb, next, K2);
                for (integer g = 0; g < r->groups && r->out; g++)
                    for (; due[g] < T && r->time[due[g]] - delay[g] <= tb; due[g]++) {
                        double at = r->time[due[g]] - delay[g];
                        if (at == tb) {
                            take(&k, b, due[g], g, tb, next, K2);
                        } else {
                            between(size, h, (at - ta) / h, X, K1, next, K2, Z, dZ);
                            take(&k, b, due[g], g, at, Z, dZ);
                        }
                    }
                double *end = next, *flows = K2;
                next = X, X = end, K2 = K1, K1 = flows;
            }
            integer bad = not_finite(X, size);
            if (bad >= 0) {
                r->failed[2 * b] = j + 1, r->failed[2 * b + 1] = bad < x ? bad : (bad - x) / (s ? s : 1);
                break;
            }
            if (r->state) memcpy(r->state + (b * T + j + 1) * x, X, sizeof(double) * x);
        }
    }
    free(memory);
    free(counters);
    return 0;
}
