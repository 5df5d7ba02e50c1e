/* Local errors, summed from sample to sample.
 *
 * Explicit steps: over each pair of steps, the increment against Simpson's rule on the rates at its three nodes. Both are
 * right to order four, and they sample the rate at other points: where it jumps or has a kink they differ by as much as
 * the step is wrong. Implicit steps: against the embedded formula, which is one order lower.
 */

/* after step number i of an interval, of length h, from X with rate dX to `next` with rate next_rate */
static void add_error(Work *k, integer i, double h, const double *X, const double *dX, const double *next,
                      const double *next_rate) {
    integer x = k->r->states;
    double *sum = k->step_error;
    if (k->r->method)
        for (integer e = 0; e < x; e++) sum[e] += k->stage[STAGES - 1][e];
    else if (i % 2)
        for (integer e = 0; e < x; e++) sum[e] += next[e] - h / 3 * next_rate[e];
    else
        for (integer e = 0; e < x; e++) sum[e] -= X[e] + h / 3 * (dX[e] + 4 * next_rate[e]);
}

/* of the readings (y) and of the states behind the angles (x - n), from sample j to j + 1, whose state is X */
static void write_error(Work *k, integer b, integer j, const double *X) {
    const Run *r = k->r;
    integer x = r->states, n = r->coordinates, m = r->sensors;
    double *out = r->error + (b * (r->samples - 1) + j) * (m + x - n), *moved = k->stage[6];
    const double *arg[4] = {X, k->u, k->constant, r->time + j + 1};
    double *res[4] = {out, k->C, k->D, k->Q};
    for (integer e = 0; e < x; e++) moved[e] = X[e] - k->step_error[e];
    set_inputs(k, r->time[j + 1]);
    if (r->out && r->groups == 1) memcpy(out, r->out + (b * r->samples + j + 1) * m, sizeof(double) * (size_t)m);
    else r->reading(arg, res, k->iw, k->w, 0);
    arg[0] = moved, res[0] = k->y;
    r->reading(arg, res, k->iw, k->w, 0);
    for (integer i = 0; i < m; i++) out[i] -= k->y[i];
    memcpy(out + m, k->step_error + n, sizeof(double) * (size_t)(x - n));
    memset(k->step_error, 0, sizeof(double) * (size_t)x);
}
